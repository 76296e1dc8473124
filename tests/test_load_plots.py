"""Figures of loads: their curves against the search's own formulas, their colours against exact verdicts, their bytes."""

from __future__ import annotations

import csv
import math
import os
import random
import subprocess
import sys
from collections.abc import Callable
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy
import pytest
from matplotlib.colors import to_hex
from matplotlib.image import imread

from certify.kernel.errors import RuleFailure
from certify.kernel.loads import monotone_ends, monotone_sturm
from certify.kernel.model import LoadLaw, PowerTerm, load_law
from certify.kernel.spec import ExpLoad, ZipLoad
from certify.report.figures import COLOURS, WORDS
from certify.report.load_maps import exponent_border
from certify.report.load_margins import load_margins
from certify.report.load_plots import exponent_map, fraction_map, margin_figure, save
from certify.search.loads import propose_load
from certify.search.voltages import float_law, smallest_eigenvalue
from tests.accept import accepts
from tests.conftest import ROOT

F = Fraction
BAND = (F(9, 10), F(11, 10))
Named = tuple[str, LoadLaw, Fraction]


def law_of(*loads: ZipLoad | ExpLoad) -> LoadLaw:
    return load_law(loads)


def zip_law(P0: Fraction, Q0: Fraction, V0: Fraction, shares: list[Fraction]) -> LoadLaw:
    parts = [(P0 * p / V0**e, Q0 * q / V0**e) for p, q, e in zip(shares[:3], shares[3:], (2, 1, 0), strict=True)]
    return law_of(ZipLoad(*parts))


def measured() -> list[Named]:
    with (ROOT / "tests/data/loads/zip-measured.csv").open(newline="") as file:
        rows = list(csv.reader(file))[1:]
    return [(name, zip_law(*map(F, cells[:3]), [*map(F, cells[3:])]), F(cells[2])) for name, *cells in rows]


def verdict(law: LoadLaw, band: tuple[Fraction, Fraction] = BAND) -> str:
    """What the tool decides, exactly."""
    for proposal in propose_load(((band, law),)):
        if accepts((law, band), proposal):
            return proposal.status
    return "unknown"


def accepted(rule: Callable[[LoadLaw, tuple[Fraction, Fraction]], bool], law: LoadLaw) -> str:
    """One of the kernel's complete rules as the decision procedure of a map."""
    try:
        rule(law, BAND)
    except RuleFailure:
        return "refuted"
    return "proved"


def tool_on_exponents(np: Fraction, nq: Fraction, square: Fraction) -> str:
    return accepted(monotone_ends, law_of(ExpLoad(F(1), np, root(square), nq, F(1))))


def tool_on_fractions(Zp: Fraction, Pp: Fraction, square: Fraction) -> str:
    return accepted(monotone_sturm, zip_law(F(1), root(square), F(1), [Zp, 1 - Zp - Pp, Pp] * 2))


def root(square: Fraction) -> Fraction:
    found = F(math.isqrt(square.numerator), math.isqrt(square.denominator))
    assert found**2 == square, "power factors here have rational tangents"
    return found


def curves(ax: Any) -> list[Any]:
    """The curves of loads: what has as many points as there are voltages."""
    return [line for line in ax.get_lines() if len(line.get_xdata()) > 50]


# Margins


def test_margins_are_those_of_the_search() -> None:
    chance = random.Random(1)
    loads = []
    for _ in range(60):
        V0 = F(chance.choice([1, 230, 20_000]))
        exponents = [F(chance.choice([-7, 0, 50, 100, 157, 200, 460, 1700]), 100) for _ in range(4)]
        terms = [PowerTerm(F(chance.randint(-500, 999), 10), chance.choice([F(1), V0]), e) for e in exponents]
        loads.append((LoadLaw(tuple(terms[:2]), tuple(terms[2:])), V0))
    v = numpy.array([0.5, 0.9, 1.0, 1.125])
    found = load_margins(loads, v)
    for (law, V0), row in zip(loads, found, strict=True):
        P, Q = (
            math.fsum(float(t.coefficient) * float(V0 / t.base_volt) ** float(t.exponent) for t in part)
            for part in (law.active, law.reactive)
        )
        unit = math.hypot(P, Q) / float(V0) ** 2
        wanted = [smallest_eigenvalue(*float_law(law)(float(x) * float(V0))) / unit for x in v]
        assert row == pytest.approx(wanted, rel=1e-7, abs=1e-9 * max(map(abs, wanted)))


def test_margins_of_simple_loads() -> None:
    """Per unit of its own admittance an impedance has margin 1, a constant power -1/v^2, a constant current 0."""
    V0, zero, one = F(230), F(0), F(1)
    impedance, power, current = (
        zip_law(F(1500), zero, V0, [*shares, zero, zero, zero])
        for shares in ([one, zero, zero], [zero, zero, one], [zero, one, zero])
    )
    generator = zip_law(F(-1500), zero, V0, [one, zero, zero, zero, zero, zero])
    balanced = zip_law(one, zero, F(1), [one, zero, -one, zero, zero, zero])  # draws nothing at V0
    huge = law_of(ExpLoad(one, F(100), zero, zero, F(20_000)))
    loads = [(law, V0) for law in (impedance, power, current, generator, LoadLaw((), ()))]
    found = load_margins([*loads, (balanced, F(1)), (huge, F(20_000))], numpy.array([0.5, 2.0]))
    wanted = [[1, 1], [-4, -0.25], [0, 0], [-1, -1], [0, 0], [-3, 0.75], [0.5**98, 2.0**98]]
    assert found == pytest.approx(numpy.array(wanted))
    assert (found[2] == 0).all(), "no rounding decides a colour"


def test_named_curves_have_the_colours_of_the_exact_verdicts() -> None:
    laws = measured()[:8]
    figure = margin_figure(laws, BAND)
    (ax,) = figure.axes
    lines = curves(ax)
    assert len(lines) == 8
    for (_, law, V0), line in zip(laws, lines, strict=True):
        status = verdict(law, (BAND[0] * V0, BAND[1] * V0))
        assert to_hex(line.get_color()) == COLOURS[status].lower()
        assert line.is_dashed() == (status == "refuted")
    assert figure.get_suptitle() == "2 of 8 loads are monotone over 0.9 to 1.1 pu"
    assert [text.get_text() for text in ax.texts] == [name for name, _, _ in laws]
    assert ax.get_xlabel() == "voltage |V| / V0 (pu)"
    assert "smallest eigenvalue" in ax.get_ylabel()
    assert "|S(V0)| / V0²" in ax.get_ylabel()
    assert ax.get_xlim() == (0.5, 1.3)
    assert ax.get_ylim()[0] < 0 < ax.get_ylim()[1]
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert set(words) == {
        "band, 0.9 to 1.1 pu",
        "zero: below, not monotone",
        *(f"{WORDS[s]} over the band" for s in ("proved", "refuted")),
    }


def test_names_do_not_touch_and_are_plain_text() -> None:
    law = zip_law(F(1), F(0), F(1), [F(1), F(0), F(0)] * 2)
    names = ["$x^2$", "a\nb_c", "n" * 99, "\u4e2d", "", "%", "{", "\\alpha"]
    figure = margin_figure([(name, law, F(1)) for name in names], BAND)
    (ax,) = figure.axes
    heights = sorted(text.get_position()[1] for text in ax.texts)
    assert all(b - a > 0.05 for a, b in pairwise(heights))
    assert [text.get_text() for text in ax.texts][1:3] == ["a b_c", "n" * 27 + "…"]


def test_verdicts_of_the_caller_count_more_than_floats() -> None:
    law = zip_law(F(1), F(0), F(1), [F(1), F(0), F(0)] * 2)
    figure = margin_figure([(s, law, F(1)) for s in COLOURS], BAND, statuses=list(COLOURS), title=None)
    assert [to_hex(line.get_color()) for line in curves(figure.axes[0])] == [c.lower() for c in COLOURS.values()]
    assert figure.get_suptitle() == "1 of 3 loads are monotone over 0.9 to 1.1 pu, 1 undecided"
    for laws, statuses in (([], None), ([("x", law, F(1))], [])):
        with pytest.raises(ValueError, match="a status for each"):
            margin_figure(laws, BAND, statuses=statuses)
    with pytest.raises(ValueError, match="range of voltages"):
        margin_figure([("x", law, F(1))], (F(1), F(1)))


def test_wide_margins_get_a_scale_that_shows_both_signs() -> None:
    zero, one = F(0), F(1)
    laws = [
        ("steep", zip_law(one, F(3), one, [one, zero, zero, F(300), F(-600), F(301)]), one),
        ("mild", zip_law(one, zero, one, [one, zero, zero] * 2), one),
    ]
    (ax,) = margin_figure(laws, BAND).axes
    assert ax.get_yscale() == "symlog"


def test_fifteen_loads_get_thin_curves_quantiles_and_shares() -> None:
    laws = measured()
    figure = margin_figure(laws, BAND)
    above, below = figure.axes
    thin = [line for line in curves(above) if line.get_linewidth() < 1]
    assert len(thin) == 15
    assert not above.texts, "no names"
    count = sum(verdict(law, (BAND[0] * V0, BAND[1] * V0)) == "proved" for _, law, V0 in laws)
    assert figure.get_suptitle() == f"{count} of 15 loads are monotone over 0.9 to 1.1 pu"
    assert [text.get_text() for text in below.texts] == [f"{100 * count / 15:.3g} % over the whole band"]
    assert below.get_xlabel() == "voltage |V| / V0 (pu)"
    assert "(%)" in below.get_ylabel()
    (line,) = curves(below)
    x, share = line.get_xdata(), line.get_ydata()
    for wanted in (0.55, 0.7, 0.9, 1.06):
        k = int(numpy.argmin(abs(x - wanted)))
        exact = [verdict(law, (F(x[k]).limit_denominator(1000) * V0, BAND[1] * V0)) for _, law, V0 in laws]
        assert share[k] == pytest.approx(100 * exact.count("proved") / 15)


def test_a_hundred_thousand_loads() -> None:
    chance = random.Random(2)
    some = [
        law_of(ExpLoad(F(chance.randint(10, 900)), F(k % 300, 100), F(chance.randint(0, 300)), F(k % 7, 2), F(230)))
        for k in range(500)
    ]
    laws = [(f"{k}", some[k % 500], F(230)) for k in range(100_000)]
    statuses = [["proved", "refuted", "unknown"][k % 3] for k in range(100_000)]
    figure = margin_figure(laws, BAND, statuses)
    assert figure.get_suptitle() == "33,334 of 100,000 loads are monotone over 0.9 to 1.1 pu, 33,333 undecided"
    above, below = figure.axes
    assert len(curves(above)) == 1, "only the median"
    few = margin_figure(laws[:500], BAND).axes[1]
    assert curves(below)[0].get_ydata() == pytest.approx(curves(few)[0].get_ydata()), (
        "the same shares as of one of each"
    )


# Maps


def exponents_in_floats(np: float, nq: float, square: float) -> float:
    """Positive if monotone on the band; near zero at the border."""
    ends = [4 * (np - 1) * v ** (2 * np) - square * (nq - 2) ** 2 * v ** (2 * nq) for v in map(float, BAND)]
    return min(*ends, np - 1)


def fractions_in_floats(Zp: float, Pp: float, square: float) -> float:
    v, Ip = numpy.linspace(float(BAND[0]), float(BAND[1]), 101), 1 - Zp - Pp
    G, radial, cross = Zp + Ip / v + Pp / v**2, Zp - Pp / v**2, square**0.5 * (Ip / v + 2 * Pp / v**2)
    matrices = numpy.moveaxis(numpy.array([[radial, cross / 2], [cross / 2, G]]), 2, 0)
    return float(numpy.linalg.eigvalsh(matrices).min())


@pytest.mark.parametrize(
    ("draw", "decide", "in_floats", "span", "words"),
    [
        (exponent_map, tool_on_exponents, exponents_in_floats, ((0, 3), (0, 6)), "exponent n"),
        (fraction_map, tool_on_fractions, fractions_in_floats, ((-0.5, 1.5), (-0.5, 1.5)), "share"),
    ],
    ids=["exponents", "fractions"],
)
def test_maps_show_the_exact_verdicts(draw: Any, decide: Any, in_floats: Any, span: Any, words: str) -> None:
    power_factors = [F(1), F(12, 13), F(3, 5)]  # their tangents 0, 5/12 and 4/3 are rational
    figure = draw(power_factors, BAND, decide, cells=9)
    assert [ax.get_title() for ax in figure.axes] == ["power factor 1", "power factor 0.9231", "power factor 0.6"]
    assert all(ax.get_xlabel().startswith(words) and "(no unit)" in ax.get_xlabel() for ax in figure.axes)
    assert figure.axes[0].get_ylabel().startswith(words)
    clear = 0
    for ax, pf in zip(figure.axes, power_factors, strict=True):
        (image,) = ax.get_images()
        codes = image.get_array()
        assert codes.shape == (9, 9)
        assert set(numpy.unique(codes)) == {0, 1}, "both verdicts occur, and all is decided"
        left, right, bottom, top = image.get_extent()
        for row in range(9):
            for column in range(9):
                x = span[0][0] + (span[0][1] - span[0][0]) * column / 8
                y = span[1][0] + (span[1][1] - span[1][0]) * row / 8
                assert left < x < right
                assert bottom < y < top
                value = in_floats(x, y, float(1 / pf**2 - 1))
                if abs(value) > 1e-6:
                    clear += 1
                    assert list(WORDS)[codes[row, column]] == ("proved" if value > 0 else "refuted"), (x, y, pf)
    assert clear > 215
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert texts[:3] == ["monotone", "not monotone", "border"]


def test_cells_are_asked_for_exactly() -> None:
    asked = set()

    def decide(np: Fraction, nq: Fraction, square: Fraction) -> str:
        assert all(isinstance(x, Fraction) for x in (np, nq, square))
        asked.add((np, nq, square))
        return "unknown"

    figure = exponent_map([F(9, 10)], BAND, decide, cells=61)
    assert len(asked) == 61**2
    assert (F(1), F(2), F(19, 81)) in asked
    assert (F(1, 20), F(1, 10), F(19, 81)) in asked
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["undecided", "border"]


@pytest.mark.parametrize(
    "band", [BAND, (F(1, 2), F(13, 10)), (F(4, 5), F(1)), (F(21, 20), F(6, 5)), (F(1, 2), F(3, 5))]
)
@pytest.mark.parametrize("pf", [F(19, 20), F(3, 5), F(1, 5)])
def test_border_of_the_exponents_solves_its_equation(band: tuple[Fraction, Fraction], pf: Fraction) -> None:
    square = float(1 / pf**2 - 1)
    drawn = exponent_border(1 / pf**2 - 1, band, (F(0), F(6)))
    assert drawn
    for np_, nq in drawn:
        used = numpy.isfinite(np_)
        assert used.sum() > 50
        x, y = np_[used], nq[used]
        assert (x >= 1).all()
        ends = [4 * (x - 1) * v ** (2 * x) - square * (y - 2) ** 2 * v ** (2 * y) for v in map(float, band)]
        size = 1 + square * (y - 2) ** 2 * max(map(float, band)) ** 12
        assert abs(numpy.minimum(*ends) / size).max() < 1e-9


def test_border_of_resistive_exponents_is_np_of_one() -> None:
    ((np_, nq),) = exponent_border(F(0), BAND, (F(0), F(6)))
    used = numpy.isfinite(np_)
    assert (np_[used] == 1).all()
    assert (nq[used].min(), nq[used].max()) == (0, 6)


def test_points_go_to_the_nearest_power_factor() -> None:
    points = [
        (F(1), F(2), F(95, 100)),
        (F(1), F(2), F(95, 100)),
        (F(1, 2), F(3), F(-7, 10)),
        (F(2), F(1), None),
        (F(9), F(0), F(1)),
    ]
    figure = exponent_map([F(1), F(7, 10)], BAND, lambda *_: "proved", points, cells=3)

    def shown(ax: Any) -> set[tuple[float, float]]:
        marks = [line for line in ax.get_lines() if line.get_marker() == "o"]
        return {(float(x), float(y)) for line in marks for x, y in zip(line.get_xdata(), line.get_ydata(), strict=True)}

    assert shown(figure.axes[0]) == {(1, 2), (2, 1)}
    assert shown(figure.axes[1]) == {(0.5, 3), (2, 1)}
    assert [text.get_text() for text in figure.axes[0].texts] == ["1 outside of the map"]
    assert "5 loads, in the panel of the nearest power factor" in [t.get_text() for t in figure.legends[0].get_texts()]


def test_maps_refuse_what_is_no_power_factor() -> None:
    for factors in ([], [F(0)], [F(11, 10)], [F(-9, 10)]):
        for draw in (exponent_map, fraction_map):
            with pytest.raises(ValueError, match="power factor"):
                draw(factors, BAND, lambda *_: "proved")


# Files

DRAW = """
from fractions import Fraction as F
from certify.kernel.model import LoadLaw, PowerTerm
from certify.report.load_plots import exponent_map, fraction_map, margin_figure, save
assert "sys" not in globals() or not {"numpy", "matplotlib", "scipy"} & set(sys.modules), "nothing heavy before it is used"
band = (F(9, 10), F(11, 10))
laws = [(f"load {k}", LoadLaw((PowerTerm(F(1), F(1), F(k, 5)),), ()), F(1)) for k in range(12)]
decide = lambda a, b, square: "proved" if a > 1 else "refuted"
save(margin_figure(laws[3:9], band), folder + "/few.svg")
save(margin_figure(laws, band), folder + "/many.png")
save(exponent_map([F(9, 10), F(1)], band, decide, [(F(1), F(2), None)], cells=7), folder + "/exponents.svg")
save(fraction_map([F(9, 10)], band, decide, cells=7), folder + "/fractions.png")
assert "sys" not in globals() or "matplotlib.pyplot" not in sys.modules
"""


def test_files_are_the_same_on_every_run(tmp_path: Path) -> None:
    """Here, and in a fresh process with other hashes, another time and another backend."""
    for run in ("1", "2"):
        (tmp_path / run).mkdir()
    exec(DRAW, {"folder": str(tmp_path / "1")})
    settings = {"PYTHONHASHSEED": "7", "SOURCE_DATE_EPOCH": "9", "MPLBACKEND": "tkagg", "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-W", "error", "-c", "import sys; folder = sys.argv[1]\n" + DRAW, str(tmp_path / "2")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, **settings})
    assert done.returncode == 0, done.stderr
    names = sorted(path.name for path in (tmp_path / "1").iterdir())
    assert len(names) == 4, "and no temporary files are left"
    for name in names:
        first, second = ((tmp_path / run / name).read_bytes() for run in ("1", "2"))
        assert first == second, name
        assert b"date" not in first.lower()
        if name.endswith("png"):
            assert imread(tmp_path / "1" / name).shape[0] > 500
        else:
            assert b"<svg" in first
    assert "load 7" in (tmp_path / "1" / "few.svg").read_text()


def test_save_writes_whole_files_or_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    law = zip_law(F(1), F(0), F(1), [F(1), F(0), F(0)] * 2)
    figure = margin_figure([("a\u4e2d\u2603$", law, F(1))], BAND)
    save(figure, tmp_path / "a.PNG")
    save(figure, str(tmp_path / "a.svg"))
    before = (tmp_path / "a.svg").read_bytes()
    for name in ("a.pdf", "a", "svg"):
        with pytest.raises(ValueError, match=r"must end in \.svg or \.png"):
            save(figure, tmp_path / name)

    def broken(*_: object, **__: object) -> None:
        raise OSError("no space left")

    monkeypatch.setattr("os.replace", broken)
    with pytest.raises(OSError, match="no space"):
        save(figure, tmp_path / "a.svg")
    assert (tmp_path / "a.svg").read_bytes() == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.PNG", "a.svg"]
