"""`simulate(at=...)`: the nodes are the times that were asked for, however the run is made."""

import casadi as ca
import numpy as np
import pytest

import varint as vi

STOP = vi.models.kepler().system.v[1] - 0.5
TIMES = np.array([0.0, 0.3, 1.7, 1.7, 5.0, 6.25])


def run(model, **more):
    return vi.simulate(model.system, q0=model.q0, v0=model.v0, backend="interpreted", **more)


@pytest.mark.parametrize("e", [0.4, 0.9])
def test_times_alone_are_enough_and_the_states_are_accurate(e):
    model = vi.models.kepler(e=e)
    motion = run(model, at=TIMES)
    np.testing.assert_array_equal(motion.t, TIMES)
    q, v = model.exact(TIMES)
    assert np.abs(motion.q - q).max() < 1e-8
    assert np.abs(motion.v - v).max() < 1e-8 / (1 - e) ** 3
    assert motion.stats["error_estimate"] <= 1e-9


@pytest.mark.parametrize(
    "how",
    [
        dict(h=0.01),
        dict(duration=8.0, steps=800),
        dict(duration=7.0, tol=1e-6),
        dict(h=0.2, time_scale="auto"),
        dict(h=0.2, time_scale="auto", duration=7.0),
    ],
)
def test_all_ways_to_run_take_them(how):
    model = vi.models.kepler(e=0.5)
    rule = None if "tol" in how else vi.gauss(4)
    motion = run(model, rule=rule, at=TIMES, **how)
    np.testing.assert_array_equal(motion.t, TIMES)
    assert np.abs(motion.q - model.exact(TIMES)[0]).max() < 1e-6


def test_times_go_backwards_with_the_run():
    model = vi.models.kepler(e=0.5)
    motion = run(model, at=-TIMES, t0=0.0)
    assert np.abs(motion.q - model.exact(-TIMES)[0]).max() < 1e-8


def test_events_stay_and_times_past_the_end_are_left_out():
    model = vi.models.kepler(e=0.5)
    y = model.system.q[1]
    motion = run(model, at=TIMES, until=(y, -1), duration=7.0)
    np.testing.assert_array_equal(motion.t, TIMES[np.pi > TIMES])
    motion = run(model, at=TIMES, events={"apse": (y, -1)})
    assert [e.time for e in motion.events] == pytest.approx([np.pi], abs=1e-8)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (dict(at=[1.0, 0.5]), "go on from t0"),
        (dict(at=[-1.0, 0.5]), "go on from t0"),
        (dict(at=[0.0]), "go on from t0"),
        (dict(at=[]), "a time or several"),
        (dict(at="now"), "a time or several"),
        (dict(at=[1.0], save_every=3), "leave save_every or at out"),
        (dict(at=[1.0], save_every=ca.SX.sym("n")), "save_every must be"),
        (dict(at=[1.0], h=-0.1), "does not lead"),
        (dict(at=[1.0, 3.0], duration=0.5), "not lie within"),
        (dict(at=[1.0, 3.0], h=0.1, steps=29), "not lie within"),
        (dict(at=[1.0, 3.0], duration=3.0, until=STOP), "before the first"),
        (dict(at=[np.nan]), "go on from t0"),
    ],
)
def test_times_that_are_none_are_refused(more, message):
    with pytest.raises(vi.InputError, match=message):
        run(vi.models.kepler(), **more)
