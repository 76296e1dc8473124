"""A user's own program: what the library gives, with its types. Checked by mypy and run by tests/test_library.py."""

from __future__ import annotations

from fractions import Fraction

import numpy
from numpy.typing import NDArray

import certify


def design() -> certify.Spec:
    grid = certify.Spec("two buses", frequency="50 Hz", base_voltage="400 V", voltage_band=("0.8 pu", "1.2 pu"))
    grid = grid.filter("lc", R=0.1, L=1.8e-3, C="25 uF").controller("phs", alpha=(-5, -4), nu=1, ki=100)
    grid = grid.node("a", filter="lc", controller="phs", reference=400 + 0j)
    grid = grid.node("b", capacitance="1 uF").load("b", Y=(20e-3, 5e-3), P=300 + 50j)
    return grid.line("a-b", "a", "b", R=0.2, L="0.4 mH", C=0)


def main() -> dict[str, float]:
    grid = design()
    certificate: certify.Certificate = certify.prove(grid)
    if certificate.outcome != "certified":
        raise SystemExit(certify.explain(certificate))
    claim: certify.CertifiedClaim = certificate["line/a-b"]
    damping: Fraction = claim.values["dissipation per squared current"]
    model: certify.PortModel = certify.dgu_model(grid, "a")
    P = certificate.storage("a")
    lost: NDArray[numpy.float64] = -(model.F.T @ P + P @ model.F) / 2
    motion: certify.Simulation = certify.simulate(grid, end="50 ms", samples=50)
    voltage = abs(motion.voltages["b"][-1])
    again: certify.Certificate = certify.check(grid, certificate.data)
    try:
        certify.check(grid.replace({"line.a-b.R": 0.3}), certificate)
    except certify.Rejected as error:
        code: str = error.code
    changed: certify.Difference = certify.diff(grid, grid.replace({"line.a-b.R": 0.3}))
    slowest: float = certify.network_model(again).eigenvalues[0].real
    return {
        "damping": float(damping),
        "least loss": float(numpy.linalg.eigvalsh(lost).min()),
        "voltage": float(voltage),
        "rejected": float(code == "K103"),
        "lost": float(len(changed.lost)),
        "slowest": slowest,
    }


if __name__ == "__main__":
    print(main())
