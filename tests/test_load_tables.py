"""`certify loads`: tables are read right, the numbers agree with independent ones, and forged certificates are rejected."""

from __future__ import annotations

import copy
import csv
import hashlib
import io
import json
import math
import random
from collections import Counter
from fractions import Fraction
from pathlib import Path
from typing import Any

import mpmath
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from certify import load_tables
from certify.cli import main
from certify.kernel.__main__ import main as kernel_main
from certify.kernel.check_loads import CRITICAL_WIDTH, FORMAT, check_table
from certify.kernel.errors import Rejected, SpecError
from certify.kernel.model import LoadLaw
from certify.kernel.table import LoadTable, decode_row
from certify.load_tables import Result, decide_table, footer, header
from certify.search.methods import METHODS

BAND = ("0.9 pu", "1.1 pu")


def decide(text: str | bytes, band: tuple[str, str] = BAND, method: str | None = None) -> list[Result]:
    data = text if isinstance(text, bytes) else text.encode()
    return [one.result for one in decide_table(LoadTable(data), band, method)]


def certificate(data: bytes, band: tuple[str, str] = BAND, method: str | None = None) -> list[str]:
    decided = list(decide_table(LoadTable(data), band, method))
    counts = Counter(one.result.verdict for one in decided)
    return [header(data, band), *(one.line for one in decided), footer(counts)]


def numbers(result: Result) -> tuple[Any, ...]:
    return (result.verdict, result.band, result.base, result.critical, result.modulus, result.pair, result.law)


# --- reading --------------------------------------------------------------------------------------------------

FRACTIONS = "name,P0,Q0,V0,Zp,Ip,Pp,Zq,Iq,Pq\nx,2000,500,230,0.5,0.3,0.2,1,-0.5,0.5\n"
SAME = {
    "units in the header": "name,P0 [kW],Q0 (kvar),V0[kV],Zp [%],Ip [%],Pp [%],Zq,Iq,Pq\nx,2,0.5,0.23,50,30,20,1,-.5,.5\n",
    "units in the cells": "name,P0,Q0,V0,Zp,Ip,Pp,Zq,Iq,Pq\nx,2 kW,0.5kvar,0.23 kV,50%,30 %,0.2,1,-5e-1,+0.5\n",
    "a unit of its own under that of the header": "name,P0 [MW],Q0,V0,Zp,Ip,Pp,Zq,Iq,Pq\nx,2 kW,500,230,0.5,0.3,0.2,1,-0.5,0.5\n",
    "another order": "Pq,Iq,Zq,Pp,Ip,Zp,V0,Q0,P0,name\n0.5,-0.5,1,0.2,0.3,0.5,230,500,2000,x\n",
    "CRLF": FRACTIONS.replace("\n", "\r\n"),
    "BOM": "\ufeff" + FRACTIONS,
    "no last newline": FRACTIONS.rstrip(),
    "quotes": '"name","P0",Q0,V0,Zp,Ip,Pp,Zq,Iq,Pq\n"x","2000",500,230,0.5,0.3,0.2,1,-0.5,0.5\n',
    "spaces": " name , P0 ,Q0,V0,Zp,Ip,Pp,Zq,Iq,Pq\n x , 2000 ,500,230, 0.5,0.3,0.2,1,-0.5,0.5 \n",
    "more columns, empty": "name,np,Yp,pf,v_min,P0,Q0,V0,Zp,Ip,Pp,Zq,Iq,Pq\nx,,,,,2000,500,230,0.5,0.3,0.2,1,-0.5,0.5\n",
    "JSON": '[{"name": "x", "P0": 2000, "Q0": "0.5 kvar", "V0": 230.0, "Zp": 0.5, "Ip": "30 %", "Pp": 2e-1, "Zq": 1, "Iq": -0.5, "Pq": 0.5, "np": null}]',
    "own band": "name,P0,Q0,V0,Zp,Ip,Pp,Zq,Iq,Pq,v_min [pu],v_max\nx,2000,500,230,0.5,0.3,0.2,1,-0.5,0.5,0.9,253\n",
    "own band in pu": "name,P0,Q0,V0,Zp,Ip,Pp,Zq,Iq,Pq,v_min,v_max\nx,2000,500,230,0.5,0.3,0.2,1,-0.5,0.5,90e-2 pu,1.1 pu\n",
}


@pytest.mark.parametrize("case", SAME, ids=str)
def test_equal_loads_however_they_are_written(case: str) -> None:
    (expected,), (found,) = decide(FRACTIONS), decide(SAME[case])
    assert found.name == "x"
    assert numbers(found) == numbers(expected)
    assert found.band == (207, 253)


def test_absolute_coefficients_are_the_same_load() -> None:
    (expected,) = decide(FRACTIONS)
    P, Q, V = Fraction(2000), Fraction(500), Fraction(230)
    cells = {"Yp": P / 2 / V**2, "Ip": P * 3 / 10 / V, "Pp": P / 5, "Yq": Q / V**2, "Iq": -Q / 2 / V, "Pq": Q / 2}
    # decimals only: take a nominal voltage by which they come out even
    row = {"V0": 250, "Yp": "0.016", "Ip": "2.4 A", "Pp": "400 W", "Yq": "8 mS", "Iq": -1, "Pq": "0.25 kvar"}
    (absolute,) = decide(json.dumps([row]))
    text = FRACTIONS.replace("230", "250")
    (fractions,) = decide(text)
    assert numbers(absolute) == numbers(fractions)
    assert expected.law is not None
    assert {t.coefficient for t in expected.law.active} == {cells["Yp"], cells["Ip"], cells["Pp"]}


@pytest.mark.parametrize(("pf", "sign"), [("0.8", 1), ("-0.8", -1), ("80 %", 1), ("1", 0), ("-1", 0)])
def test_power_factor(pf: str, sign: int) -> None:
    (found,) = decide(f"P0,pf,V0,np,nq\n1000,{pf},230,1.5,2.5\n")
    assert found.law is not None
    Q = [t.coefficient for t in found.law.reactive]
    assert ([sign * Fraction(750)] if sign else []) == Q


def test_irrational_power_factor_is_right_to_forty_digits() -> None:
    (found,) = decide("P0,pf,V0,np,nq\n1000,0.9,230,1.5,2.5\n")
    with mpmath.workdps(60):
        exact = 1000 * mpmath.sqrt(1 / mpmath.mpf("0.81") - 1)
        Q = found.law.reactive[0].coefficient  # type: ignore[union-attr]
        assert abs(mpmath.mpf(Q.numerator) / Q.denominator - exact) < mpmath.mpf(10) ** -36


def test_names_and_blank_lines_and_numbers_of_rows() -> None:
    text = 'name,P0,Q0,V0,np,nq\n\n"a, ""b""",1,0,1,2,2\n , ,,\t,,\n"Kühl–schrank",1,0,1,2,2\n,1,0,1,2,2\n'
    assert [(r.number, r.name) for r in decide(text)] == [(3, 'a, "b"'), (5, "Kühl–schrank"), (6, "")]
    rows = [{"name": "é", "P0": 1, "Q0": 0, "V0": 1, "np": 2, "nq": 2}] * 2
    assert [(r.number, r.name) for r in decide(json.dumps(rows))] == [(1, "é"), (2, "é")]


def test_rows_of_all_kinds_in_one_table() -> None:
    text = (
        "name,P0,Q0,pf,V0,Zp,Ip,Pp,Zq,Iq,Pq,Yp,Yq,np,nq\n"
        "f,1,,0.9,1,1,0,0,1,0,0,,,,\n"
        "a,,,,1,,0,0,,0,0,1,0,,\n"
        "e,1,0,,1,,,,,,,,,1.5,0\n"
    )
    kinds = [decode_row(n, cells, {}, BAND).kind for n, cells in LoadTable(text.encode())]  # type: ignore[arg-type]
    assert kinds == ["ZIP in fractions", "ZIP in absolute coefficients", "exponential"]
    assert [r.verdict for r in decide(text)] == ["proved"] * 3


# --- numbers, against others ----------------------------------------------------------------------------------

share = st.integers(-20, 20).map(lambda k: Fraction(k, 10))


def decimal(x: Fraction) -> str:
    with mpmath.workdps(30):
        return mpmath.nstr(mpmath.mpf(x.numerator) / x.denominator, 25) if x.denominator > 1 else str(x)


@st.composite
def zip_cells(draw: st.DrawFn) -> dict[str, str]:
    Zp, Ip, Zq, Iq = (draw(share) for _ in range(4))
    cells = {"Zp": Zp, "Ip": Ip, "Pp": 1 - Zp - Ip, "Zq": Zq, "Iq": Iq, "Pq": 1 - Zq - Iq}
    cells |= {
        "P0": Fraction(draw(st.integers(-20, 100))),
        "Q0": Fraction(draw(st.integers(-50, 50))),
        "V0": Fraction(10),
    }
    return {key: decimal(value) for key, value in cells.items()}


@st.composite
def exp_cells(draw: st.DrawFn) -> dict[str, str]:
    cells = {"np": Fraction(draw(st.integers(-10, 40)), 10), "nq": Fraction(draw(st.integers(-20, 80)), 10)}
    cells |= {
        "P0": Fraction(draw(st.integers(-5, 100))),
        "Q0": Fraction(draw(st.integers(-50, 50))),
        "V0": Fraction(10),
    }
    return {key: decimal(value) for key, value in cells.items()}


def to_csv(*rows: dict[str, str]) -> str:
    columns = list(dict.fromkeys(key for row in rows for key in row))
    lines = [",".join(row.get(column, "") for column in columns) for row in rows]
    return "\n".join([",".join(columns), *lines]) + "\n"


def values_at(law: LoadLaw, v: float) -> tuple[float, float, float]:
    """G, G + v G', v B', straight from P and Q by the quotient rule."""
    parts = []
    for part in (law.active, law.reactive):
        terms = [
            (float(t.coefficient) * (v / float(t.base_volt)) ** float(t.exponent), float(t.exponent)) for t in part
        ]
        parts.append((math.fsum(x for x, _ in terms), math.fsum(x * e for x, e in terms)))
    (P, vP), (Q, vQ) = parts
    return P / v**2, (vP - P) / v**2, -(vQ - 2 * Q) / v**2


def eigenvalue(law: LoadLaw, v: float) -> float:
    G, radial, cross = values_at(law, v)
    return (G + radial) / 2 - math.hypot((G - radial) / 2, cross / 2)


def current(law: LoadLaw, V: complex) -> complex:
    v = abs(V)
    P, Q = (
        math.fsum(float(t.coefficient) * (v / float(t.base_volt)) ** float(t.exponent) for t in part)
        for part in (law.active, law.reactive)
    )
    return (P - 1j * Q) / v**2 * V


def grid(band: tuple[Fraction, ...], count: int) -> list[float]:
    low, high = map(float, band)
    return [low + (high - low) * k / count for k in range(count + 1)]


@settings(max_examples=30, deadline=None)
@given(st.one_of(zip_cells(), exp_cells()), st.integers(0, 10**6))
def test_numbers_against_floats(cells: dict[str, str], seed: int) -> None:
    (r,) = decide(to_csv(cells))
    law, band = r.law, r.band
    assert law is not None
    size = max(1e-9, max(abs(x) for v in band for x in values_at(law, float(v))))
    least = min(eigenvalue(law, v) for v in grid(band, 400))
    assert r.verdict in ("proved", "refuted")
    assert (r.verdict == "proved") == (least >= 0) or abs(least) < 1e-6 * size
    if r.modulus is not None:
        assert 0.98 * least - 1e-12 * size <= r.modulus <= least + 1e-12 * size
        assert r.strict
    elif r.verdict == "proved":
        assert least < 1e-6 * size
    unit = abs(complex(float(cells["P0"]), float(cells["Q0"]))) / float(cells["V0"]) ** 2
    if r.margin is not None and (r.modulus or r.violation):
        at = float(r.modulus) if r.modulus else least
        assert r.margin == pytest.approx(at / unit, rel=1e-3, abs=1e-9 * size / unit)
    rng = random.Random(seed)
    assert r.lipschitz is not None
    for _ in range(40):
        V, U = (
            rng.uniform(*map(float, band)) * complex(math.cos(a), math.sin(a))
            for a in (0, rng.choice([1e-3, rng.uniform(-3, 3)]))
        )
        difference = current(law, V) - current(law, U)
        assert abs(difference) <= float(r.lipschitz) * abs(V - U) * (1 + 1e-9) + 1e-12
        product = (difference * (V - U).conjugate()).real
        if r.verdict == "proved":
            assert product >= float(r.modulus or 0) * abs(V - U) ** 2 - 1e-12 * size * abs(V) ** 2
    if r.verdict == "refuted":
        assert r.tangent is not None
        with mpmath.workdps(80):
            assert refuting_product(r) < 0
            assert abs(refuting_product(r) - to_mpf(r.product)) <= abs(to_mpf(r.product)) * mpmath.mpf(10) ** -8
        assert min(values_at(law, float(r.violation or 0))[0], least) < 1e-9 * size


def to_mpf(x: Fraction | None) -> Any:
    assert x is not None
    return mpmath.mpf(x.numerator) / x.denominator


def refuting_product(r: Result) -> Any:
    """<V - U, I(V) - I(U)> with the phasors themselves, the second turned by twice atan(t)."""
    assert r.law is not None
    angle = 2 * mpmath.atan(to_mpf(r.tangent))
    phasors = [to_mpf(r.pair[0]) * mpmath.mpc(1), to_mpf(r.pair[1]) * mpmath.expj(angle)]
    currents = []
    for V in phasors:
        P, Q = (
            mpmath.fsum(to_mpf(t.coefficient) * (abs(V) / to_mpf(t.base_volt)) ** to_mpf(t.exponent) for t in part)
            for part in (r.law.active, r.law.reactive)
        )
        currents.append((P - 1j * Q) / abs(V) ** 2 * V)
    return mpmath.re(mpmath.conj(phasors[1] - phasors[0]) * (currents[1] - currents[0]))


@settings(max_examples=30, deadline=None)
@given(st.one_of(zip_cells(), exp_cells()))
def test_critical_voltage_against_mpmath(cells: dict[str, str]) -> None:
    (r,) = decide(to_csv(cells))
    law, top = r.law, float(r.band[1])
    assert law is not None

    def least(v: Any) -> Any:
        """D over G^2 + .., the sign of which decides together with G's."""
        parts = [
            [(to_mpf(t.coefficient) * (v / to_mpf(t.base_volt)) ** to_mpf(t.exponent), to_mpf(t.exponent)) for t in p]
            for p in (law.active, law.reactive)
        ]
        (P, vP), (Q, vQ) = ((mpmath.fsum(x for x, _ in t), mpmath.fsum(x * e for x, e in t)) for t in parts)
        size = P**2 + vP**2 + Q**2 + vQ**2
        return min(P / mpmath.sqrt(size), (P * (vP - P) - (vQ - 2 * Q) ** 2 / 4) / size) if size else mpmath.mpf(0)

    with mpmath.workdps(40):
        if r.critical == ():
            assert least(to_mpf(r.band[1])) < 0
        elif r.critical is not None:
            low, high = r.critical
            assert 0 <= high - low <= CRITICAL_WIDTH * high
            assert all(least(mpmath.mpf(v)) >= -1e-30 for v in grid((high, r.band[1]), 200)[1:])
            if low:
                assert least(to_mpf(low)) < 0
                root = mpmath.findroot(least, (to_mpf(low), to_mpf(high)), solver="anderson", tol=1e-25, verify=False)
                assert low - CRITICAL_WIDTH * high <= Fraction(str(root)) <= high + CRITICAL_WIDTH * high
        else:
            assert any(abs(least(mpmath.mpf(v))) < 1e-3 for v in grid((Fraction(top) / 1000, Fraction(top)), 400))


def test_critical_voltage_in_closed_form() -> None:
    """D = Yp^2 v^4 - Pp^2 changes sign at the root of Pp/Yp; an exponential one where 4 (np-1) v^(2 np - 2 nq) = ..."""
    (r,) = decide("V0,Yp,Ip,Pp,Yq,Iq,Pq\n10,2,0,162,0,0,0\n")
    assert r.critical
    assert r.critical[0] <= 9 <= r.critical[1]
    (r,) = decide("P0,Q0,V0,np,nq\n1,1,10,2,1\n")  # 4 v^2 > 1
    assert r.critical
    assert r.critical[0] <= 5 <= r.critical[1]
    (r,) = decide("P0,Q0,V0,np,nq\n1,0,10,0,0\n")
    assert (r.verdict, r.critical) == ("refuted", ())
    (r,) = decide("P0,Q0,V0,np,nq\n1,0,10,1.3,0\n")
    assert (r.verdict, r.critical) == ("proved", (0, 0))
    (r,) = decide("P0,Q0,V0,np,nq\n0,0,10,1.3,0\n")
    assert (r.verdict, r.strict, r.margin) == ("proved", False, None)


# --- what must not matter -------------------------------------------------------------------------------------

unfussy = settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.too_slow])


@unfussy
@given(st.lists(st.one_of(zip_cells(), exp_cells()), min_size=2, max_size=5), st.randoms())
def test_order_of_rows(rows: list[dict[str, str]], rng: random.Random) -> None:
    named = [{"name": f"r{k}", **row} for k, row in enumerate(rows)]
    expected = {r.name: numbers(r) for r in decide(to_csv(*named))}
    rng.shuffle(named)
    assert {r.name: numbers(r) for r in decide(to_csv(*named))} == expected


@unfussy
@given(st.one_of(zip_cells(), exp_cells()), st.sampled_from(["7", "1000", "0.001", "3.3"]))
def test_scaling_changes_no_verdict(cells: dict[str, str], factor: str) -> None:
    (plain,) = decide(to_csv(cells))

    def scaled(*keys: str) -> Result:
        (result,) = decide(to_csv({**cells, **{k: decimal(Fraction(cells[k]) * Fraction(factor)) for k in keys}}))
        return result

    for other, unit in ((scaled("P0", "Q0"), 1), (scaled("V0"), Fraction(factor))):
        assert other.verdict == plain.verdict
        assert (other.critical is None) == (plain.critical is None)
        if plain.critical and other.critical:
            assert [float(x) for x in other.critical] == pytest.approx(
                [float(x * unit) for x in plain.critical], rel=2e-9
            )
        if plain.margin and other.margin and plain.verdict == "proved":
            assert other.margin == pytest.approx(plain.margin, rel=0.03)


@unfussy
@given(st.one_of(zip_cells(), exp_cells()))
def test_units_change_nothing(cells: dict[str, str]) -> None:
    def in_kilo(text: str) -> str:
        return decimal(Fraction(text) / 1000)

    other = {
        ("P0 [kW]" if k == "P0" else "V0 [kV]" if k == "V0" else k): in_kilo(v) if k in ("P0", "V0") else v
        for k, v in cells.items()
    }
    other["Q0"] = f"{Fraction(cells['Q0']) * 1000} mvar".replace("mvar", "mvar")
    assert [numbers(r) for r in decide(to_csv(cells))] == [numbers(r) for r in decide(to_csv(other))]


@settings(max_examples=15, deadline=None)
@given(st.one_of(zip_cells(), exp_cells()))
def test_methods_agree(cells: dict[str, str]) -> None:
    table = to_csv(cells)
    (best,) = decide(table)
    for method in METHODS:
        (found,) = decide(table, method=method)
        if method == "sampled":
            assert found.verdict in ("conditional", "refuted")
            assert (found.verdict == "refuted") <= (best.verdict == "refuted")
        else:
            assert found.verdict in (best.verdict, "unknown"), method
            assert found.rule in (None, f"monotone-{method}", "voltage-pair")
        assert found.critical == best.critical
    complete = ["sturm", "sos"] if "Zp" in cells else ["ends"]
    assert decide(table, method=complete[0])[0].verdict == best.verdict


# --- certificates ---------------------------------------------------------------------------------------------

TABLE = (
    b"name,P0,Q0,V0,Zp,Ip,Pp,Zq,Iq,Pq,np,nq\n"
    b"bernstein,2000,100,230,0.96,0.05,-0.01,0,0,1,,\n"
    b"refuted,100,50,230,0.5,0.1,0.4,0.5,0.1,0.4,,\n"
    b"anywhere,1000,-200,230,1,0,0,1,0,0,,\n"
    b"exponential,1000,300,230,,,,,,,1.6,0.5\n"
    b"never,1000,300,230,,,,,,,0.2,2.5\n"
    b"bad,1000,300,0,,,,,,,0.2,2.5\n"
)
LINES = certificate(TABLE)
STATUSES = ["proved", "refuted", "proved", "proved", "refuted", "bad input"]


def accepted(lines: list[str], table: bytes = TABLE) -> list[str]:
    found = check_table(table, ("\n".join(lines) + "\n").encode())
    return [row.verdict.status if row.verdict else "bad input" for row in found]


def test_an_honest_certificate_is_accepted() -> None:
    assert accepted(LINES) == STATUSES
    again = json.dumps(json.loads(LINES[1]), indent=None, separators=(", ", " : "))
    assert accepted([LINES[0], again, *LINES[2:]])


def forged(position: int, **changes: Any) -> list[str]:
    entry = json.loads(LINES[position]) | changes
    return [*LINES[:position], json.dumps(entry), *LINES[position + 1 :]]


def rejected(lines: list[str] | bytes, code: str = "K", table: bytes = TABLE) -> None:
    data = lines if isinstance(lines, bytes) else ("\n".join(lines) + "\n").encode()
    with pytest.raises(Rejected) as caught:
        list(check_table(table, data))
    assert caught.value.code.startswith(code)


def told(lines: list[str]) -> list[Any]:
    found = check_table(TABLE, ("\n".join(lines) + "\n").encode())
    return [r.verdict and (r.verdict.status, r.verdict.rule, r.verdict.modulus, r.verdict.critical) for r in found]


def rejected_or_the_same(lines: list[str]) -> bool:
    try:
        return told(lines) == told(LINES)
    except Rejected:
        return True


WRONG: tuple[Any, ...] = (None, "", "x", "0", "-1", "1/0", "2/4", "01", [], {}, ["1"], [[]], True, 0, "9" * 2000)


@pytest.mark.parametrize("position", range(1, 7))
def test_any_changed_field_is_rejected(position: int) -> None:
    entry = json.loads(LINES[position])

    def paths(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
        found = [path] if path else []
        return found + [
            p for key in (value if isinstance(value, dict) else ()) for p in paths(value[key], (*path, key))
        ]

    for path in paths(entry):
        for wrong in WRONG:
            changed = copy.deepcopy(entry)
            target = changed
            for key in path[:-1]:
                target = target[key]
            if target[path[-1]] == wrong or (path, wrong) in ((("critical",), None), (("data",), {})):
                continue
            target[path[-1]] = wrong
            lines = [*LINES[:position], json.dumps(changed), *LINES[position + 1 :]]
            if path[-1] in ("points", "t") and wrong in ("0", "1", "-1"):
                assert rejected_or_the_same(lines)  # fewer points, or another angle, may do
            else:
                rejected(lines)
        changed = copy.deepcopy(entry)
        target = changed
        for key in path[:-1]:
            target = target[key]
        del target[path[-1]]
        if path == ("data", "modulus"):
            continue  # proves less, and says so
        rejected([*LINES[:position], json.dumps(changed), *LINES[position + 1 :]])
    rejected(forged(position, more=1), "K")
    for status in ("proved", "refuted", "conditional", "unknown", "bad input", "Proved"):
        if status != entry["status"]:
            rejected(forged(position, status=status))


def shifted(bracket: str, share: Fraction) -> str:
    return " ".join(str(Fraction(x) * (1 + share)) for x in bracket.split())


def test_critical_voltages_cannot_be_moved() -> None:
    for position in (1, 2):
        critical = json.loads(LINES[position])["critical"]
        for bracket in (
            shifted(critical["bracket"], Fraction(1, 10**6)),
            shifted(critical["bracket"], Fraction(-1, 10**6)),
            "0 0",
            " ".join(reversed(critical["bracket"].split())),
            f"0 {critical['bracket'].split()[1]}",
            critical["bracket"].split()[0],
            critical["bracket"] + " 253",
            "253 253",
            "-1 -1",
            "230 253",
            "",
        ):
            for rule in (
                "monotone-bernstein",
                "monotone-sturm",
                "monotone-ends",
                "monotone-enclosure",
                "monotone-sos",
                "sampled",
            ):
                data: dict[str, Any] = {"monotone-bernstein": {"points": "253"}, "sampled": {"points": "9"}}.get(
                    rule, {}
                )
                data = {"points": "253", "bits": "160"} if rule == "monotone-enclosure" else data
                data = {"grams": [[["1"]] * 4]} if rule == "monotone-sos" else data
                rejected(forged(position, critical={"bracket": bracket, "rule": rule, "data": data}), "K201")
        rejected(forged(position, critical="never"), "K201")
    anywhere = {"bracket": "0 0", "rule": "monotone-sturm", "data": {}}
    rejected(forged(5, critical=anywhere), "K201")
    assert accepted(forged(1, critical=None))  # says less


def test_a_zip_load_that_fails_near_zero_is_not_proved_from_zero_on() -> None:
    """D v^4 vanishes at zero whatever D does: the rule about the ends must not look there."""
    table = b"V0,Yp,Ip,Pp,Yq,Iq,Pq\n1,2,1,0,0,1,0\n"
    lines = certificate(table)
    entry = json.loads(lines[1])
    assert entry["critical"]["bracket"] != "0 0"
    for rule, data in (
        ("monotone-ends", {}),
        ("monotone-enclosure", {"points": "1", "bits": "64"}),
        ("monotone-enclosure", {"points": "0 1", "bits": "64"}),
    ):
        entry["critical"] = {"bracket": "0 0", "rule": rule, "data": data}
        rejected([lines[0], json.dumps(entry), lines[2]], "K201", table)


def test_a_modulus_cannot_be_raised() -> None:
    for position in (1, 3, 4):
        data = json.loads(LINES[position])["data"]
        raised = str(Fraction(data["modulus"]) * Fraction(101, 100))
        rejected(forged(position, data=data | {"modulus": raised}), "K201")
    data = json.loads(LINES[2])["data"]
    rejected(forged(2, data=data | {"modulus": "1/1000"}), "K201")


@pytest.mark.parametrize(
    "change",
    [
        {"v": "0"},
        {"v": "300"},
        {"v": "253"},
        {"pair": "0 230"},
        {"pair": "207 300"},
        {"pair": "230 230"},
        {"pair": "230"},
        {"pair": "230 231 232"},
        {"t": "9" * 900},
        {"t": "1"},
        {"corner": "000000"},
        {"corner": "+00000"},
        {"corner": "0"},
        {"corner": ""},
    ],
    ids=str,
)
def test_pairs_that_refute_nothing(change: dict[str, str]) -> None:
    data = json.loads(LINES[2])["data"] | change
    if change == {"corner": "000000"}:
        assert accepted(forged(2, data=data))  # the values themselves
    else:
        rejected(forged(2, data=data), "K201")


def test_gram_matrices_and_points_that_prove_nothing() -> None:
    for grams in (
        [],
        [[]],
        [[[], [], [], []]],
        [[["1"], [], ["1"], []]],
        [[["1"], ["1"]]],
        [[["1 0"], [], [], []]],
        [[[["1"]], [], [], []]],
        "x",
    ):
        rejected(forged(1, rule="monotone-sos", data={"grams": grams}), "K201")
    for n in (900, 960, 980, 988, 991, 995, 2000, 100_000):
        line = json.dumps(json.loads(LINES[1]) | {"rule": "monotone-sos", "data": {"grams": "@"}}).replace(
            '"@"', "[" * n + "]" * n
        )
        rejected([LINES[0], line, *LINES[2:]])
    for points in ("", "253 207", "207 207", "207  253", " 207", "207 253 "):
        rejected(forged(1, data={"points": points}), "K201")
    (refuted,) = (json.loads(LINES[2]),)
    for rule, data in (
        ("monotone-bernstein", {"points": "207 253"}),
        ("monotone-bernstein", {"points": "300 400"}),
        ("monotone-sturm", {}),
        ("monotone-ends", {}),
        ("monotone-enclosure", {"points": "230", "bits": "64"}),
        ("monotone-enclosure", {"points": "1 2 300", "bits": "400"}),
        ("sampled", {"points": "1"}),
        ("voltage-pair", refuted["data"]),
    ):
        rejected(forged(2, status="proved", rule=rule, data=data), "K201")


def test_points_of_a_thousand_digits_are_refused_at_once() -> None:
    table = b"P0,Q0,V0,np,nq\n1,0.0001,1,66,65\n"
    lines = certificate(table)
    far = 10**495 + 7
    points = " ".join(str(Fraction(95 * 10**493 + k, far)) for k in range(20))
    entry = json.loads(lines[1]) | {
        "status": "proved",
        "rule": "monotone-enclosure",
        "data": {"points": points, "bits": "64"},
    }
    rejected([lines[0], json.dumps(entry), lines[2]], "K201", table)


def test_lines_removed_doubled_swapped_and_cut() -> None:
    for k in range(1, len(LINES) - 1):
        rejected([*LINES[:k], *LINES[k + 1 :]])
        rejected([*LINES[:k], LINES[k], *LINES[k:]])
        rejected([*LINES[:k], "", *LINES[k:]])
    rejected([LINES[0], LINES[2], LINES[1], *LINES[3:]], "K105")
    for variant in (LINES[:-1], LINES[:3], LINES[:1], [], [*LINES, LINES[-1]], [*LINES, ""]):
        rejected(variant)
    whole = ("\n".join(LINES) + "\n").encode()
    for cut in range(1, len(whole) - 1, 97):
        rejected(whole[:cut])
    for total in ({}, {"proved": 3}, {"proved": 6}, {"proved": "3"}, None, [], 6):
        rejected([*LINES[:-1], json.dumps({"total": total})], "K111")
    rejected([*LINES[:-1], json.dumps(json.loads(LINES[-1]) | {"more": 1})], "K101")
    for text in ("{", "null", "[]", "1", '{"total": 1.5}', '{"row": 2, "row": 2}', "\x00"):
        rejected([LINES[0], text, *LINES[2:]], "K10")
    rejected([LINES[0], LINES[1].replace('"row":2', '"row":2.0'), *LINES[2:]], "K101")
    rejected([LINES[0], LINES[1].replace('"row":2', '"row":NaN'), *LINES[2:]], "K101")
    assert accepted([line + "\r" for line in LINES])  # a change of line ends says the same


def test_header() -> None:
    first = json.loads(LINES[0])
    for change, code in (
        ({"format": "certify/loads@2"}, "K102"),
        ({"format": None}, "K102"),
        ({"table_sha256": "0" * 64}, "K103"),
        ({"table_sha256": None}, "K103"),
        ({"band": ["0.9 pu"]}, "K101"),
        ({"band": "0.9 pu"}, "K101"),
        ({"band": [0, 1]}, "K101"),
        ({"band": ["0.1 pu", "1.1 pu"]}, "K201"),
        ({"band": ["0.95 pu", "1.1 pu"]}, "K201"),
        ({"more": 1}, "K101"),
    ):
        rejected([json.dumps(first | change), *LINES[1:]], code)
    assert accepted([json.dumps(first | {"provenance": ["anything"]}), *LINES[1:]])
    for band in (["1.1 pu", "0.9 pu"], ["x", "y"], ["-1", "1"], ["0", "1"]):
        with pytest.raises(SpecError):
            accepted([json.dumps(first | {"band": band}), *LINES[1:]])


@settings(max_examples=30, deadline=None)
@given(st.integers(0, len(TABLE) - 1), st.integers(0, 255))
def test_any_changed_byte_of_the_table_is_rejected(position: int, byte: int) -> None:
    changed = bytearray(TABLE)
    changed[position] = byte
    if bytes(changed) != TABLE:
        rejected(LINES, "K103", bytes(changed))


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**9), st.integers(32, 126))
def test_any_changed_byte_of_the_certificate_is_rejected_or_says_the_same(position: int, byte: int) -> None:
    whole = bytearray(("\n".join(LINES) + "\n").encode())
    position %= len(whole)
    whole[position] = byte
    try:
        found = list(check_table(TABLE, bytes(whole)))
    except (Rejected, SpecError):
        return
    assert [r.verdict.status if r.verdict else "bad input" for r in found] == STATUSES


def test_rows_of_json_that_change_their_type() -> None:
    good = {"P0": 1, "Q0": 0, "V0": 1, "np": 2, "nq": 2}
    rows = [
        good,
        5,
        None,
        [],
        "x",
        good | {"P0": [1]},
        good | {"P0": True},
        good | {"V0": {}},
        good | {"name": ["x"]},
        {},
    ]
    table = json.dumps(rows).encode()
    lines = certificate(table)
    assert accepted(lines, table) == ["proved"] + ["bad input"] * 9
    for k in range(2, len(rows) + 1):
        entry = json.loads(lines[1]) | {"row": k}
        rejected([*lines[:k], json.dumps(entry), *lines[k + 1 :]], "K105", table)


# --- the command ----------------------------------------------------------------------------------------------


def run(capsys: pytest.CaptureFixture[str], *arguments: Any) -> tuple[int, str, str]:
    code = main([str(a) for a in arguments])
    output = capsys.readouterr()
    assert "Traceback" not in output.err
    assert "internal error" not in output.err
    return code, output.out, output.err


GOOD = b"\n".join(line for line in TABLE.splitlines() if not line.startswith(b"bad")) + b"\n"
PROVED = b"P0,Q0,V0,np,nq\n1000,100,230,1.5,2\n"


@pytest.mark.parametrize(
    ("table", "method", "expected"),
    [
        (PROVED, (), 0),
        (GOOD, (), 1),
        (TABLE, ("--keep-going",), 2),
        (PROVED, ("--method", "sampled"), 3),
        (PROVED, ("--method", "sos"), 3),
    ],
)
def test_check_agrees_with_the_command(
    table: bytes, method: tuple[str, ...], expected: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, cert = tmp_path / "t.csv", tmp_path / "t.cert"
    file.write_bytes(table)
    assert run(capsys, "loads", file, "--cert", cert, *method)[0] == expected
    code, out, _ = run(capsys, "check", file, cert)
    assert code == expected
    assert "from 0.9 pu to 1.1 pu" in out  # or a narrowed band would go unnoticed
    code, out, _ = run(capsys, "check", file, cert, "--json")
    assert (code, json.loads(out)["exit_code"], json.loads(out)["band"]) == (expected, expected, list(BAND))
    assert kernel_main([str(file), str(cert)]) == expected
    assert "from 0.9 pu to 1.1 pu" in capsys.readouterr().out
    file.write_bytes(table + b"\n")
    code, _, err = run(capsys, "check", file, cert)
    assert (code, "K103" in err) == (4, True)
    assert kernel_main([str(file), str(cert)]) == 4
    capsys.readouterr()


def test_outputs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "t.csv"
    file.write_bytes(GOOD)
    code, out, err = run(capsys, "loads", file, "-o", tmp_path / "o.csv", "--cert", tmp_path / "c")
    assert (code, err) == (1, "")
    assert "5 loads from 0.9 pu to 1.1 pu" in out
    assert "row 3 (refuted): fails at" in out
    assert "row 6 (never): fails at 0.9 pu, and it is not monotone at the top of its band either" in out
    rows = list(csv.DictReader(io.StringIO((tmp_path / "o.csv").read_text())))
    assert [row["verdict"] for row in rows] == ["proved", "refuted", "proved", "proved", "refuted"]
    assert [row["row"] for row in rows] == ["2", "3", "4", "5", "6"]
    assert rows[2]["critical_V"] == rows[2]["critical_pu"] == "0"
    assert rows[4]["critical_V"] == "none"
    assert float(rows[1]["product_W"]) < 0 < float(rows[0]["modulus_S"])
    results = decide(GOOD)
    for row, result in zip(rows, results, strict=True):
        if result.critical:
            assert result.critical[1] <= Fraction(row["critical_V"]) <= result.critical[1] * (1 + Fraction(1, 10**11))
        assert Fraction(row["lipschitz_S"]) >= (result.lipschitz or 0)
    assert run(capsys, "loads", file, "-o", tmp_path / "o.json")[0] == 1
    exact = json.loads((tmp_path / "o.json").read_text())
    assert [(e["row"], e["verdict"]) for e in exact] == [(r.number, r.verdict) for r in results]
    assert [e.get("modulus") for e in exact] == [None if r.modulus is None else str(r.modulus) for r in results]
    code, out, _ = run(capsys, "loads", file, "--json")
    document = json.loads(out)
    assert (code, document["exit_code"], document["counts"]) == (1, 1, {"proved": 3, "refuted": 2})
    assert document["rows"] == exact
    assert {p.name for p in tmp_path.iterdir()} == {"t.csv", "o.csv", "o.json", "c"}


def test_a_faulty_row(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "t.csv"
    file.write_bytes(TABLE)
    (tmp_path / "old.csv").write_text("old")
    code, out, err = run(capsys, "loads", file, "-o", tmp_path / "old.csv", "--cert", tmp_path / "c")
    assert (code, out) == (2, "")
    assert "row 7, column V0" in err
    assert (tmp_path / "old.csv").read_text() == "old"
    assert {p.name for p in tmp_path.iterdir()} == {"t.csv", "old.csv"}  # no temporary files either
    code, out, err = run(capsys, "loads", file, "-o", tmp_path / "o.csv", "--cert", tmp_path / "c", "--keep-going")
    assert code == 2
    assert "row 7, column V0" in err
    rows = list(csv.DictReader(io.StringIO((tmp_path / "o.csv").read_text())))
    assert [row["verdict"] for row in rows][-1] == "bad input"
    assert "row 7, column V0" in rows[-1]["faults"]
    assert (tmp_path / "c").read_text().splitlines() == LINES
    code, out, _ = run(capsys, "loads", file, "--json")
    assert (code, json.loads(out)["exit_code"]) == (2, 2)


def test_two_runs_and_many_processes_write_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(load_tables, "CHUNK", 7)
    file = tmp_path / "t.csv"
    file.write_text("P0,Q0,V0,np,nq\n" + "".join(f"1000,{k % 90},230,1.{k % 7},{k % 5}\n" for k in range(60)))
    for name, jobs in (("a", "1"), ("b", "2"), ("c", "1")):
        run(capsys, "loads", file, "--jobs", jobs, "-o", tmp_path / f"{name}.csv", "--cert", tmp_path / f"{name}.cert")
    for suffix in ("csv", "cert"):
        texts = {(tmp_path / f"{name}.{suffix}").read_bytes() for name in "abc"}
        assert len(texts) == 1
    file.write_text(file.read_text() + "x\n" * 3)
    errors = {run(capsys, "loads", file, "--jobs", jobs)[2] for jobs in "12"}
    assert len(errors) == 1


def test_sampling_is_no_proof(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, cert = tmp_path / "t.csv", tmp_path / "t.cert"
    file.write_bytes(PROVED)
    code, out, _ = run(capsys, "loads", file, "--method", "sampled", "--cert", cert)
    assert code == 3
    assert "sampled only" in out
    lines = cert.read_text().splitlines()
    entry = json.loads(lines[1])
    assert (entry["status"], entry["rule"]) == ("conditional", "sampled")
    rejected([lines[0], json.dumps(entry | {"status": "proved"}), '{"total":{"proved":1}}'], "K201", PROVED)
    rejected([lines[0], lines[1], '{"total":{"proved":1}}'], "K111", PROVED)
    for points in ("0", "-1", "1/2", "4097", "99999999"):
        rejected([lines[0], json.dumps(entry | {"data": {"points": points}}), lines[2]], "K201", PROVED)


def test_where_nothing_can_be_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "t.csv"
    file.write_bytes(PROVED)
    other = tmp_path / "same.csv"
    for arguments, option in (
        (("-o", tmp_path / "o.txt"), "-o"),
        (("-o", tmp_path / "o"), "-o"),
        (("-o", tmp_path), "-o"),
        (("-o", file), "-o"),
        (("-o", tmp_path / "no" / "o.csv"), "-o"),
        (("-o", tmp_path / f"{'x' * 300}.csv"), "-o"),
        (("--cert", file), "--cert"),
        (("--cert", tmp_path), "--cert"),
        (("-o", other, "--cert", other), "--cert"),
        (("--plot", file), "--plot"),
        (("--plot", tmp_path / "no" / "p"), "--plot"),
        (("--plot", tmp_path / "p", "--power-factor", "x"), "--power-factor"),
        (("--plot", tmp_path / "p", "--power-factor", "1/0"), "--power-factor"),
        (("--plot", tmp_path / "p", "--power-factor", "1.1"), "--power-factor"),
        (("--plot", tmp_path / "p", "--cells", "-3"), "--cells"),
        (("--plot", tmp_path / "p", "--cells", "1000000"), "--cells"),
        (("--jobs", "-1"), "--jobs"),
        (("--jobs", "0"), "--jobs"),
    ):
        code, out, err = run(capsys, "loads", file, *arguments)
        assert (code, out) == (2, ""), arguments
        assert "error[U001]" in err
        assert option in err
        assert [p.name for p in tmp_path.iterdir()] == ["t.csv"]
        assert file.read_bytes() == PROVED


def test_plot(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "t.csv"
    file.write_bytes(GOOD)
    code, out, _ = run(capsys, "loads", file, "--plot", tmp_path / "figures", "--power-factor", "0.9", "--cells", "5")
    assert code == 1
    names = {p.name for p in (tmp_path / "figures").iterdir()}
    assert names == {f"{name}.{suffix}" for name in ("margins", "exponents", "fractions") for suffix in ("svg", "png")}
    assert all(p.stat().st_size > 1000 for p in (tmp_path / "figures").iterdir())
    assert "figures/margins.svg" in out


# --- specs as input, and `certify prove` with loads that have a cut-off ---------------------------------------

SPEC = """format = "certify/microgrid@1"
frequency = "50 Hz"
base_voltage = "20 kV"
voltage_band = ["0.6 pu", "1.2 pu"]
[filter.lc]
R = "0.1 ohm"
L = "1.8 mH"
C = "25 uF"
[controller.pi]
kind = "state-feedback"
let = {{ kp = 1000 }}
K11 = "1 - kp*L"
K12 = "R - 1001"
K13 = 1000
[node.a]
dgu = {{ filter = "lc", controller = "pi", reference = ["0.9 pu", "0.5 pu"] }}
[node.b]
capacitance = "1 uF"
load = [{loads}]
[[line]]
name = "1"
from = "a"
to = "b"
R = 1
L = 1e-3
C = 0
"""
BELOW = ', below = "constant-impedance"'


def spec_of(*loads: str) -> str:
    return SPEC.format(loads=", ".join(f"{{ {load} }}" for load in loads))


# the loads at a node: (kind, parameters, lower end of the band or None without a cut-off), and whether they are monotone
CASES: dict[str, tuple[list[str], bool]] = {
    "admittance": ([f'kind = "zip", Y = ["75 uS", "10 uS"]{BELOW}'], True),
    "current": ([f'kind = "zip", Y = ["75 uS", 0], I = ["1 A", "0.1 A"]{BELOW}'], True),
    "two cut-offs": (
        [
            f'kind = "exp", P0 = "5 kW", np = 1.5, band = ["0.5 pu", "1.2 pu"]{BELOW}',
            f'kind = "exp", P0 = "9 kW", np = 1.3, Q0 = "2 kvar", nq = 0.7, band = ["0.8 pu", "1.2 pu"]{BELOW}',
        ],
        True,
    ),
    "constant power helped by an admittance": (
        [
            f'kind = "zip", P = ["5 kW", "1 kvar"], band = ["0.8 pu", "1.1 pu"]{BELOW}',
            f'kind = "zip", Y = ["40 uS", 0], band = ["0.6 pu", "1.2 pu"]{BELOW}',
        ],
        True,
    ),
    "constant power": ([f'kind = "zip", P = ["5 kW", 0], band = ["0.8 pu", "1.1 pu"]{BELOW}'], False),
    "too little help": (
        [
            f'kind = "exp", P0 = "5 kW", np = 0.3, band = ["0.8 pu", "1.1 pu"]{BELOW}',
            f'kind = "zip", Y = ["2 uS", 0]{BELOW}',
        ],
        False,
    ),
    "fails only between the cut-offs": (
        [
            f'kind = "exp", P0 = "5 kW", np = 0.5, band = ["0.5 pu", "1.2 pu"]{BELOW}',
            f'kind = "exp", P0 = "40 kW", np = 3.5, band = ["0.9 pu", "1.2 pu"]{BELOW}',
            'kind = "zip", Y = ["0.1 uS", 0], band = ["0.3 pu", "1.2 pu"]',
        ],
        True,
    ),
    "within tolerances": (
        [
            f'kind = "exp", P0 = "5 kW", np = 1.5, Q0 = "3 kvar", nq = 2.5, tolerance = {{ P0 = "20 %", Q0 = "20 %" }}{BELOW}'
        ],
        True,
    ),
    "not within tolerances": (
        [
            f'kind = "exp", P0 = "5 kW", np = 1.05, Q0 = "3.6 kvar", nq = 1.5, tolerance = {{ P0 = "30 %", Q0 = "30 %" }}{BELOW}'
        ],
        False,
    ),
    "reactive": ([f'kind = "exp", P0 = "1 kW", np = 1.5, Q0 = "5 kvar", nq = 0.5{BELOW}'], False),
}


def brute_force(spec: str, seed: int) -> float:
    """The least <V - U, I(V) - I(U)> / |V - U|^2 over samples of the disk, the loads built from the parsed spec by hand."""
    import tomllib

    loads = tomllib.loads(spec)["node"]["b"]["load"]
    base, rng = 20_000.0, random.Random(seed)

    def number(raw: Any) -> float:
        if not isinstance(raw, str):
            return float(raw)
        value, _, unit = raw.partition(" ")
        return float(value) * {"pu": base, "uS": 1e-6, "kW": 1e3, "kvar": 1e3, "A": 1.0, "%": 0.01, "": 1.0}[unit]

    bands = [[number(x) for x in load.get("band", ["0.6 pu", "1.2 pu"])] for load in loads]
    low, top = (
        (
            0.0
            if all("below" in x for x in loads)
            else max(b[0] for x, b in zip(loads, bands, strict=True) if "below" not in x)
        ),
        min(b[1] for b in bands),
    )

    def power(load: Any, v: float, signs: tuple[int, int]) -> complex:
        share = [number(load.get("tolerance", {}).get(k, 0)) for k in ("P0", "Q0")]
        if load["kind"] == "zip":
            return sum(complex(*map(number, load.get(k, [0, 0]))) * v**e for k, e in (("Y", 2), ("I", 1), ("P", 0)))
        P = number(load["P0"]) * (1 + signs[0] * share[0]) * (v / base) ** load["np"]
        return complex(P, number(load.get("Q0", 0)) * (1 + signs[1] * share[1]) * (v / base) ** load.get("nq", 0))

    def total(V: complex, signs: tuple[int, int]) -> complex:
        v, result = abs(V), 0j
        for load, band in zip(loads, bands, strict=True):
            frozen = band[0] if "below" in load and v < band[0] else v
            result += power(load, frozen, signs).conjugate() / frozen**2 * V
        return result

    least = math.inf
    for k in range(6000):
        v = rng.uniform(low, top)
        u = rng.uniform(low, top) if k % 3 == 0 else min(max(v * (1 + rng.uniform(-0.02, 0.02)), low), top)
        angle = rng.uniform(-math.pi, math.pi) if k % 3 == 0 else rng.uniform(-0.05, 0.05)
        V, U = complex(v), u * complex(math.cos(angle), math.sin(angle))
        if abs(V - U) > 1e-3:
            for signs in ((0, 0), (-1, -1), (-1, 1), (1, 1), (1, -1)):
                product = ((V - U).conjugate() * (total(V, signs) - total(U, signs))).real
                least = min(least, product / abs(V - U) ** 2)
    return least


@pytest.mark.parametrize("case", CASES, ids=str)
def test_cutoffs_against_brute_force(case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    loads, _ = CASES[case]
    text = spec_of(*loads)
    least = brute_force(text, 5)
    assert abs(least) > 1e-9  # a case that samples decide
    file, cert = tmp_path / "s.toml", tmp_path / "c.json"
    file.write_text(text)
    code, out, _ = run(capsys, "prove", file, "-o", cert, "--json")
    claim = next(c for c in json.loads(out)["claims"] if c["id"] == "load/b")
    assert claim["status"] == ("proved" if least > 0 else "refuted"), least
    assert run(capsys, "check", file, cert)[0] == code
    code, out, _ = run(capsys, "loads", file, "--json")
    (row,) = json.loads(out)["rows"]
    assert row["verdict"] == claim["status"]
    assert code == (0 if least > 0 else 1)
    if row.get("modulus"):
        assert float(Fraction(row["modulus"])) <= least


def test_specs_as_tables(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run(capsys, "loads", "specs/cigre-mv.toml", "-o", tmp_path / "o.csv")
    assert code == 0
    assert "proved" in out
    rows = list(csv.DictReader(io.StringIO((tmp_path / "o.csv").read_text())))
    assert {row["verdict"] for row in rows} == {"proved"}
    import tomllib

    text = spec_of('kind = "zip", Y = ["75 uS", "75 uS"]', 'kind = "exp", P0 = "5 kW", np = 0.5')
    (tmp_path / "s.toml").write_text(text)
    (tmp_path / "s.json").write_text(json.dumps(tomllib.loads(text)))
    results = [json.loads(run(capsys, "loads", tmp_path / name, "--json")[1])["rows"] for name in ("s.toml", "s.json")]
    assert results[0] == results[1]
    assert [row["name"] for row in results[0]] == ["b"]
    code, _, err = run(capsys, "loads", tmp_path / "s.toml", "--cert", tmp_path / "c")
    assert (code, "certify prove" in err, (tmp_path / "c").exists()) == (2, True, False)
    (tmp_path / "bad.toml").write_text(text.replace("75 uS", "75 uF"))
    code, _, err = run(capsys, "loads", tmp_path / "bad.toml", "-o", tmp_path / "x.csv")
    assert (code, "node.b.load[0].Y" in err, (tmp_path / "x.csv").exists()) == (2, True, False)


def test_methods_of_prove_and_gate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, cert = tmp_path / "s.toml", tmp_path / "c.json"
    file.write_text(spec_of('kind = "zip", Y = ["75 uS", 0], I = ["1 A", "0.1 A"]'))
    for method in METHODS:
        code, out, _ = run(capsys, "prove", file, "--method", method, "-o", cert, "--json")
        claim = next(c for c in json.loads(out)["claims"] if c["id"] == "load/b")
        rule = method if method == "sampled" else f"monotone-{method}"
        status, expected = ("conditional", 3) if method == "sampled" else ("proved", 0)
        assert (claim["rule"], claim["status"], code) == (rule, status, expected), method
        assert run(capsys, "check", file, cert)[0] == expected
    document = json.loads(cert.read_text())  # of the last, which is sampled
    assert document["verdict"] == "conditional"
    assert "sampled/b" in {entry["name"] for entry in document["assumptions"]}
    ledger = [entry for entry in document["assumptions"] if entry["name"] != "sampled/b"]
    proved = [c | ({"status": "proved"} if c["status"] == "conditional" else {}) for c in document["claims"]]
    other = [c | ({"rule": "monotone-sturm"} if c["id"] == "load/b" else {}) for c in proved]
    for change, code in (
        ({"verdict": "certified"}, "K111"),
        ({"assumptions": ledger}, "K110"),
        ({"claims": proved}, "K107"),
        ({"claims": other}, "K201"),
        ({"claims": proved, "assumptions": ledger, "verdict": "certified"}, "K107"),
    ):
        cert.write_text(json.dumps(document | change))
        result = run(capsys, "check", file, cert)
        assert (result[0], f"rejected[{code}]" in result[2]) == (4, True), result[2]
    assert run(capsys, "gate", file)[0] == 0
    assert run(capsys, "gate", file, "--method", "sampled")[0] == 3
    assert run(capsys, "gate", file, "--method", "sampled", "--allow", "sampled/a")[0] == 3
    code, out, _ = run(capsys, "gate", file, "--method", "sampled", "--allow", "sampled/b")
    assert (code, "1 of 1 passed" in out, "conditional load/b" in out) == (0, True, True)
    file.write_text(spec_of('kind = "zip", P = ["5 kW", 0]'))
    assert run(capsys, "gate", file, "--method", "sampled", "--allow", "sampled/b")[0] == 1


def test_the_header_names_format_and_table() -> None:
    first = json.loads(LINES[0])
    assert first["format"] == FORMAT
    assert first["table_sha256"] == hashlib.sha256(TABLE).hexdigest()
