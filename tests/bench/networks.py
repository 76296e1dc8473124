"""Generated microgrids for benchmarks: as many nodes as asked for, no two parameters alike, trees or meshes."""

from __future__ import annotations

import json
import random
from typing import Any


def microgrid(nodes: int, mesh: bool = False, seed: int = 1) -> bytes:
    """A JSON spec: every second node has a DGU, PI and IDA-PBC in turn, most nodes have a ZIP or EXP load.

    A tree has nodes - 1 lines; a mesh has about half as many again.
    """
    rng = random.Random(seed)

    def near(value: float, unit: str) -> str:
        return f"{value * rng.uniform(0.8, 1.25):.6g} {unit}"

    filters: dict[str, Any] = {}
    controllers: dict[str, Any] = {}
    table: dict[str, Any] = {}
    for k in range(nodes):
        node: dict[str, Any] = {}
        if k % 2 == 0:
            filters[f"f{k}"] = {"R": near(0.1, "ohm"), "L": near(1.8, "mH"), "C": near(25, "uF")}
            if k % 4 == 0:
                a, b = round(rng.uniform(500, 2000), 2), round(rng.uniform(500, 2000), 2)
                damping = "R - ki*(1/kp + 1)"
                controllers[f"c{k}"] = {
                    "kind": "state-feedback",
                    "let": {"kp": a, "ki": b},
                    "K11": "1 - kp*L",
                    "K12": [[damping, "-w0*L"], ["w0*L", damping]],
                    "K13": "ki",
                }
            else:
                gains = {"alpha": -rng.uniform(2, 9), "nu": rng.uniform(0.5, 2), "ki": rng.uniform(50, 200)}
                controllers[f"c{k}"] = {"kind": "ida-pbc", **{key: f"{value:.5g}" for key, value in gains.items()}}
            voltage = [near(0.95, "pu"), near(0.02, "pu")]
            node["dgu"] = {"filter": f"f{k}", "controller": f"c{k}", "reference": voltage}
        if k % 5 == 1:
            power = near(60, "")
            node["load"] = [
                {
                    "kind": "exp",
                    "P0": f"{power}kW",
                    "np": f"{rng.uniform(1.5, 1.9):.2f}",
                    "Q0": f"{power}kvar",
                    "nq": f"{rng.uniform(1.6, 2.2):.2f}",
                }
            ]
        elif k % 5:
            y, i, p = near(70, "uS"), near(0.3, "A"), rng.uniform(4, 7)
            node["load"] = [{"kind": "zip", "Y": [y, y], "I": [i, i], "P": [f"{p:.4f} kW", f"{p:.4f} kvar"]}]
        table[f"n{k}"] = node
    pairs = [(rng.randrange(max(0, k - 40), k), k) for k in range(1, nodes)]
    if mesh:
        pairs += [tuple(sorted(rng.sample(range(nodes), 2))) for _ in range(nodes // 2)]  # type: ignore[misc]
    lines = [
        {
            "name": f"l{k}",
            "from": f"n{a}",
            "to": f"n{b}",
            "R": near(0.4, "ohm"),
            "L": near(1, "mH"),
            "C": near(150, "nF"),
        }
        for k, (a, b) in enumerate(pairs)
    ]
    spec = {
        "format": "certify/microgrid@1",
        "name": f"generated {'mesh' if mesh else 'tree'} of {nodes} nodes",
        "frequency": "50 Hz",
        "base_voltage": "20 kV",
        "voltage_band": ["0.7 pu", "1.2 pu"],
        "filter": filters,
        "controller": controllers,
        "node": table,
        "line": lines,
    }
    return json.dumps(spec, indent=0).encode()
