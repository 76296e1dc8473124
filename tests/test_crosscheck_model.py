"""What the comparison of both models makes of corners: loads outside their bands, poles nearby, figures without a value."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from certify.certificate import prove
from certify.crosscheck.claimed import Claimed
from certify.crosscheck.model import compare_loads, compare_model, compare_rest, find_reference
from certify.kernel.spec import decode
from certify.simulator.plant import Plant
from certify.simulator.starts import zero_state
from tests.mutation_cases import CURRENT, RL, SPECS, ZIP, dgu, spec


def claimed(document: dict[str, Any]) -> Claimed:
    data = json.dumps(document).encode()
    proved = prove(data)
    return Claimed(Plant(decode(data)), proved.data, proved.verdict)


def test_a_load_with_a_pole_near_its_disk_is_compared() -> None:
    """Its proof bounds the denominator from below; without that no Lipschitz constant of the load is known."""
    law = ["Vd/40 + Vd/1e9/(0.002 + (Vd - 388)^2/10000)", "Vq/60 - 5"]
    own = claimed(spec({"a": {**dgu("phs", "lc"), "load": [{**CURRENT, "I": law}]}}))
    assert own.status["load/a"] == "proved"
    x = find_reference(own)
    assert x is not None
    assert all(found.agrees for found in (*compare_loads(own), *compare_model(own, x)))


def test_a_load_outside_its_band_is_left_out() -> None:
    nodes = {
        "a": {**dgu("phs", "lc"), "load": [{**ZIP, "band": ["1.1 pu", "1.5 pu"]}]},
        "b": {**dgu("phs", "lc", limits=["600 V", "600 V"]), "load": [RL, ZIP]},
    }
    own = claimed(spec(nodes, *SPECS["limits"]["line"][:1]))
    x = find_reference(own)
    assert x is not None
    names = {found.where for found in compare_model(own, x)}
    assert "dgu/a" not in names
    assert {"dgu/b", "line/ba", "branch/b/0", "mode/b/d", "limits"} <= names
    at_zero = compare_model(own, zero_state(own.plant))
    assert not {found.where for found in at_zero} & {"dgu/a", "dgu/b", "mode/b/d"}
    assert all(found.agrees for found in (*compare_loads(own), *compare_model(own, x), *at_zero))


def test_rests_at_limits_and_all_states_are_compared() -> None:
    own = claimed(SPECS["limits"])
    x = find_reference(own)
    assert x is not None
    found = {finding.where: finding for finding in compare_rest(own, x)}
    assert found.keys() == {"a", "c", "a, at limits", "c, at limits", "all states"}
    assert all(finding.agrees for finding in found.values())
    rest = own.saturated["c"]
    own.saturated["c"] = replace(rest, terminals={name: -u for name, u in rest.terminals.items()})
    assert [finding.where for finding in compare_rest(own, x) if not finding.agrees] == ["c, at limits"]


@pytest.mark.parametrize("first", ["a", "c"])
def test_a_voltage_that_is_no_number_agrees_with_nothing(first: str) -> None:
    own = claimed(SPECS["limits"])
    x = find_reference(own)
    assert x is not None
    last = own.island(first)[-1]
    x[own.plant.slices["voltage", last]] = np.nan
    assert not next(found for found in compare_rest(own, x) if found.where == first).agrees
