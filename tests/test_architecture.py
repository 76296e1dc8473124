"""The rules that make the kernel trustworthy: what it imports, how large it is, that it has no floats."""

from __future__ import annotations

import ast
import io
import subprocess
import sys
import tokenize
from pathlib import Path

import pytest

from certify.certificate import prove
from certify.commands import COMMANDS, command_module
from tests.conftest import ROOT

KERNEL = sorted((ROOT / "certify" / "kernel").glob("*.py"))
LAYERS = [
    "atomic",
    "kernel",
    "locations",
    "diagnostics",
    "provenance",
    "values",
    "rests",
    "storages",
    "verdicts",
    "search",
    "certificate",
    "accepted",
    "reuse",
    "comparison",
    "difference",
    "editing",
    "building",
    "synthesis",
    "tolerance",
    "phases",
    "jumps",
    "simulation",
    "samples",
    "settling",
    "crosscheck",
    "checking",
    "arrays",
    "load_tables",
    "exits",
    "gating",
    "importing",
    "report",
    "explaining",
    "commands",
    "cli",
    "testing",
]  # an arrow points from left to right only
LIMIT = 2_850  # lines of code that the stability of every equilibrium rests on; "small enough to read in one sitting"
RESTS = {
    "balls.py",
    "equilibrium.py",
    "region.py",
}  # where an island rests, and from where it returns, on these as well
RESTS_LIMIT = 460
TABLES = {"table.py", "check_loads.py"}  # only certificates of tables of loads rest on these as well
TABLE_LIMIT = 400


def imported(path: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, "imports are absolute"
            names.add(node.module or "")
    return names


@pytest.mark.parametrize("path", KERNEL, ids=lambda p: p.name)
def test_kernel_imports_the_standard_library_and_itself(path: Path) -> None:
    for name in imported(path):
        top = name.split(".")[0]
        assert name.startswith("certify.kernel") or (top != "certify" and top in sys.stdlib_module_names), name
        assert (
            top not in {"time", "datetime", "os", "socket", "random", "subprocess", "urllib", "math"} or name == "math"
        )


@pytest.mark.parametrize("path", KERNEL, ids=lambda p: p.name)
def test_kernel_has_no_floats(path: Path) -> None:
    for node in ast.walk(ast.parse(path.read_text())):
        assert not (isinstance(node, ast.Constant) and isinstance(node.value, float | complex))
        assert not (isinstance(node, ast.Name) and node.id in {"float", "complex", "eval", "exec"})
        if isinstance(node, ast.ImportFrom) and node.module == "math":
            assert {alias.name for alias in node.names} <= {"gcd", "lcm", "isqrt"}
        assert not (isinstance(node, ast.Assert)), "python -O drops assertions"


def code_lines(path: Path) -> int:
    """Lines with code: not blank, not only a comment or docstring."""
    source = path.read_text()
    docstrings: set[int] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            docstrings |= set(range(node.lineno, (node.end_lineno or 0) + 1))
    skipped = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in skipped:
            lines |= set(range(token.start[0], token.end[0] + 1))
    return len(lines - docstrings)


def test_the_kernel_is_small() -> None:
    assert sum(code_lines(path) for path in KERNEL if path.name not in TABLES | RESTS) <= LIMIT
    assert sum(code_lines(path) for path in KERNEL if path.name in RESTS) <= RESTS_LIMIT
    assert sum(code_lines(path) for path in KERNEL if path.name in TABLES) <= TABLE_LIMIT
    for path in KERNEL:
        if path.name not in {*TABLES, "__main__.py"}:
            assert not {f"certify.kernel.{name.removesuffix('.py')}" for name in TABLES} & imported(path)
        if path.name not in {*RESTS, "proofs.py"}:
            assert not {"certify.kernel.equilibrium", "certify.kernel.region"} & imported(path)


def test_arrows_point_one_way() -> None:
    for path in (ROOT / "certify").rglob("*.py"):
        parts = path.relative_to(ROOT / "certify").with_suffix("").parts
        if parts[0] not in LAYERS:
            continue
        later = LAYERS[LAYERS.index(parts[0]) + 1 :]
        for name in imported(path):
            if name.startswith("certify."):
                assert name.split(".")[1] not in later, f"{path.name} imports {name}"


def test_every_module_of_a_command_is_a_command() -> None:
    files = {path.stem for path in (ROOT / "certify" / "commands").glob("*.py")} - {"__init__", "common"}
    assert files == {command_module(name).__name__.split(".")[-1] for name in COMMANDS}
    for name in COMMANDS:
        assert f"certify {name} " in command_module(name).EXAMPLE


def test_the_simulator_shares_no_model_with_the_kernel() -> None:
    """It reads the same spec, and tells faults in the same way: no equation, matrix or load law is common to both."""
    shared = {"spec", "errors", "quantity", "reader", "claims"}
    for path in (ROOT / "certify" / "simulator").glob("*.py"):
        for name in imported(path):
            parts = name.split(".")
            assert parts[0] != "certify" or parts[1] == "simulator" or (parts[1] == "kernel" and parts[2] in shared), (
                name
            )


@pytest.mark.parametrize("name", ["cigre-mv.toml", "cigre-mv-as-printed.toml", "two-inverters.toml"])
def test_kernel_runs_on_bare_python(name: str, tmp_path: Path) -> None:
    """Isolated mode, no site-packages, nothing on the path but the package itself."""
    spec = ROOT / "specs" / name
    certificate = prove(spec.read_bytes())
    file = tmp_path / "c.json"
    file.write_bytes(certificate.data)
    code = f"import sys; sys.path.insert(0, {str(ROOT)!r}); from certify.kernel.__main__ import main; sys.exit(main(sys.argv[1:]))"
    done = subprocess.run(
        [sys.executable, "-I", "-S", "-c", code, str(spec), str(file)], capture_output=True, text=True, check=False
    )
    assert done.returncode == {"certified": 0, "refuted": 1}[certificate.verdict.outcome], done.stderr
    assert done.stdout.strip().endswith(certificate.verdict.outcome)
    for arguments, expected in (
        ([str(spec)], 2),
        ([str(spec), str(spec)], 4),
        ([str(file), str(file)], 2),
        (["x", "y"], 2),
    ):
        again = subprocess.run(
            [sys.executable, "-I", "-S", "-c", code, *arguments], capture_output=True, text=True, check=False
        )
        assert again.returncode == expected
        assert "Traceback" not in again.stderr


def modules_after(*arguments: str) -> set[str]:
    code = (
        "import sys, io, contextlib\n"
        "from certify.cli import main\n"
        "with contextlib.redirect_stdout(io.StringIO()): main(sys.argv[1:])\n"
        "print('\\n'.join(sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=True, cwd=ROOT
    )
    return {name.split(".")[0] for name in done.stdout.split()}


def test_prove_and_check_on_cigre_import_no_third_party_package(tmp_path: Path) -> None:
    file = str(tmp_path / "c.json")
    heavy = {"numpy", "scipy", "cvxpy", "clarabel", "sympy", "flint", "rich", "mpmath"}
    assert not modules_after("prove", "specs/cigre-mv.toml", "-o", file) & heavy
    loaded = modules_after("check", "specs/cigre-mv.toml", file)
    foreign = {n for n in loaded if n not in sys.stdlib_module_names and not n.startswith(("_", "certify"))}
    assert foreign <= {"sitecustomize", "usercustomize", "google", "mpl_toolkits", "sphinxcontrib"}
