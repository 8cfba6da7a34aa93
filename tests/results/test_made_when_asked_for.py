"""Times, controls and figures of a run are made when they are first looked at, and nobody can
tell.
"""

import copy
import pickle
from dataclasses import fields, replace

import numpy as np
import pytest

import varint as vi

MODEL = vi.models.kepler(e=0.5)


def fresh():
    how = dict(time_scale="auto", h=0.6, rule=vi.gauss(6), duration=7.0, save_every=3)
    return vi.simulate(MODEL.system, q0=MODEL.q0, v0=MODEL.v0, **how)


WHOLE = fresh()
LATE = "t", "k", "u", "stats"
WAYS = {
    "itself": lambda motion: motion,
    "a copy": copy.copy,
    "a deep copy": copy.deepcopy,
    "pickled": lambda motion: pickle.loads(pickle.dumps(motion)),
    "replaced": replace,
    "all of its nodes": lambda motion: motion[:],
}


@pytest.mark.parametrize("name", LATE)
def test_any_of_them_may_be_the_first(name):
    motion = fresh()
    assert name not in vars(motion)
    first = getattr(motion, name)
    assert getattr(motion, name) is first
    for x in ("t", "k", "u"):
        assert np.array_equal(getattr(motion, x), getattr(WHOLE, x))


@pytest.mark.parametrize("way", WAYS)
def test_every_way_to_another_one_has_them(way):
    other = WAYS[way](fresh())
    for field in fields(WHOLE):
        assert hasattr(other, field.name)
    assert np.array_equal(other.t, WHOLE.t) and np.array_equal(other.k, WHOLE.k)
    assert other.stats.keys() == WHOLE.stats.keys()
    assert other.stats["iterations"] == WHOLE.stats["iterations"]


def test_steps_are_all_of_them_however_many_are_kept():
    how = dict(time_scale="auto", h=0.6, rule=vi.gauss(6), duration=7.0)
    motion = vi.simulate(MODEL.system, q0=MODEL.q0, v0=MODEL.v0, **how)
    assert len(WHOLE) < len(motion) and WHOLE.u.shape == motion.u.shape
    assert WHOLE.stats["steps"] == motion.stats["steps"] == len(motion) - 1


def test_what_nobody_has_is_refused_by_its_name():
    for motion in (fresh(), WHOLE):
        with pytest.raises(AttributeError, match="no attribute 'speed'"):
            motion.speed  # noqa: B018


def test_errors_of_properties_are_their_own(monkeypatch):
    monkeypatch.setattr(vi.Trajectory, "duration", property(lambda motion: motion.q.lost))
    with pytest.raises(AttributeError, match=r"ndarray.*no attribute 'lost'"):
        fresh().duration  # noqa: B018
