"""A suite of a user's own, whole: a controller design, its properties, and the feeder that it is for.

    pip install 'certify-eip[testing]'
    pytest --certify-report proofs

Beside it, feeder.microgrid.toml is a test by its name, and constant-power.refuted.microgrid.toml one that has to be refuted.
"""

import pytest
from hypothesis import given, settings

from certify.testing import assert_certified, assert_passive, dgu_spec, filters, loads, w0


def design(filter, x=1000, b=1, h=5):
    """Gains of u = K11 V + K12 I + K13 v for a filter, from stiffness x, weight b and damping h."""
    R, L = filter.R, filter.L
    return {"K11": 1 - b - L * x, "K12": [[R - h, -w0() * L], [w0() * L, R - h]], "K13": h * x}


@settings(deadline=None)
@given(filters(L=("0.5 mH", "5 mH")))
def test_the_design_is_passive_with_every_filter(filter):
    assert_passive(filter, design(filter))


@settings(deadline=None, max_examples=25)
@given(filters(), loads(monotone=True))
def test_it_carries_every_monotone_load(filter, load):
    assert_certified(dgu_spec(filter, design(filter), load=load))


@pytest.mark.certify_spec("feeder.microgrid.toml")
def test_the_feeder_has_one_equilibrium(certify_verdict):
    assert {claim.status for claim in certify_verdict.claims if claim.kind == "equilibrium"} == {"proved"}
