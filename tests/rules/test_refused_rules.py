"""What is no rule is refused; the spelling of names is forgiving."""

from __future__ import annotations

from decimal import Context

import numpy as np
import pytest

import varint as vi
from varint.rules.compositions import COMPOSITIONS

PRECISE = Context(prec=60)
NAMES = list(COMPOSITIONS)
GAUSS, LOBATTO = range(1, 17), range(2, 11)
ROUND_OFF = 4e-15  # of sums of ten products of size 1
EVERY_RULE = [*map(vi.gauss, GAUSS), *map(vi.lobatto, LOBATTO), *map(vi.composition, NAMES)]


@pytest.mark.parametrize("stages", [0, 17, -1, 2.0, 2.5, "x", [2], None, True, np.nan])
@pytest.mark.parametrize("family, least, most", [(vi.gauss, 1, 16), (vi.lobatto, 2, 10)])
def test_stages_out_of_range_are_refused_with_the_range(family, least, most, stages):
    # a cache that answers 2.0 or True from these would hide the error
    (
        vi.gauss(2),
        vi.lobatto(2),
        vi.gauss(1),
    )
    with pytest.raises(vi.InputError, match=rf"takes a whole number from {least} to {most}, got "):
        family(stages)


def test_one_lobatto_point_is_refused():
    with pytest.raises(vi.InputError, match="from 2 to 10, got 1"):
        vi.lobatto(1)


@pytest.mark.parametrize("name", ["yoshida5", "", None, 4, ["verlet"], {"verlet"}])
def test_unknown_compositions_are_refused_with_the_list_of_those_known(name):
    with pytest.raises(vi.InputError) as refused:
        vi.composition(name)
    assert all(known in str(refused.value) for known in NAMES) and repr(name) in str(refused.value)


@pytest.mark.parametrize("spelling", ["Störmer-Verlet", "STÖRMER–VERLET", "leapfrog", " verlet "])
def test_spelling_of_compositions_is_forgiving(spelling):
    assert vi.composition(spelling) is vi.composition("verlet")


@pytest.mark.parametrize(
    "fields, message",
    [
        (dict(nodes=(0.5,), weights=(0.9,), points=(0.0, 1.0)), "weights sum to 0.9"),
        (dict(nodes=(0.5, 0.7), weights=(1.0,), points=(0.0, 1.0)), "2 nodes but 1 weights"),
        (dict(nodes=(0.5,), weights=(1.0,), points=(0.0, 0.5)), "increase from 0 to 1"),
        (dict(nodes=(0.5,), weights=(1.0,), points=(0.0, 0.7, 0.3, 1.0)), "increase from 0 to 1"),
        (dict(nodes=(0.0,), weights=(1.0,), kicks=(1.0,), drifts=(1.0,)), "a kick may be 0"),
        (
            dict(nodes=(0.0, 1.0), weights=(0.5, 0.5), kicks=(0.5, 0.5), drifts=(1.1,)),
            "drifts sum to 1.1",
        ),
        (dict(nodes=(0.5,), weights=(1.0,)), "needs control points"),
    ],
)
def test_inconsistent_rules_are_refused(fields, message):
    with pytest.raises(vi.InputError, match=message):
        vi.Rule("mine", 2, **fields)
