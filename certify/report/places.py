"""Where in a spec a claim comes from: the path of its part, and those of what this part uses."""

from __future__ import annotations

from certify.locations import Locations


def path_of(claim: str, where: Locations) -> str:
    """The path, in the spec, of the part that a claim is about; empty for one about the whole network.

    >>> where = Locations(b'[node.a]\\ndgu = { filter = "lc", controller = "pi" }')
    >>> path_of("dgu/a", where), path_of("equilibrium/a", where), path_of("microgrid", where)
    ('node.a.dgu', 'node.a', '')
    """
    kind, _, rest = claim.partition("/")
    name, _, last = rest.rpartition("/") if kind in ("branch", "mode") else (rest, "", "")
    if kind == "line":
        return f"line.{name}"
    if kind in ("dgu", "mode"):
        return f"node.{name}.dgu"
    if kind == "load":
        return f"node.{name}.load"
    if kind == "branch":
        return _branch(name, last, where)
    return f"node.{name}" if name else ""


def used_by(claim: str, where: Locations) -> list[tuple[str, str]]:
    """What the part of a claim refers to: the path of each, and what it is."""
    path = path_of(claim, where)
    kinds = {"dgu": ("controller", "filter"), "mode": ("controller", "filter"), "line": ("type",)}
    found = []
    for kind in kinds.get(claim.partition("/")[0], ()):
        name = where.words(f"{path}.{kind}")
        table = "line_type" if kind == "type" else kind
        if name is not None and where.find(f"{table}.{name}"):
            found.append((f"{table}.{name}", f"the {table.replace('_', ' ')} {name}"))
    return found


def _branch(node: str, number: str, where: Locations) -> str:
    """The k-th series R-L load of a node among all its loads."""
    path = f"node.{node}.load"
    place = where.find(path)
    count = len(place.items or ()) if place else 0
    branches = [k for k in range(count) if where.words(f"{path}[{k}].kind") == "rl"]
    known = number.isdecimal() and int(number) < len(branches)
    return f"{path}[{branches[int(number)]}]" if known else path
