"""Runs to a tolerance whose steps follow the scene: the short way gives what the long one does."""

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.codegen.two_runs import NOT_PROVED, NOT_SHORT
from varint.integration import to_tolerance
from varint.integration.time_transformation import physical_time, varying_call


def scene() -> vi.System:
    q, v = vi.coordinates("x", "y")
    c = vi.Parameters(mu=1.0)
    return vi.System(q, v, ca.sumsqr(v) / 2 + c.mu / ca.norm_2(q), params=c)


def start(e: float) -> dict:
    return {"q0": [1 - e, 0.0], "v0": [0.0, np.sqrt((1 + e) / (1 - e))]}


def told(motion: vi.Trajectory) -> dict:
    """All but what depends on the clock, as the gear that is ready does."""
    return {k: v for k, v in motion.stats.items() if k not in ("seconds", "plan", "backend")}


def never(*_, **__):
    raise AssertionError("the long way is taken")


@pytest.mark.parametrize("tol", (1e-3, 1e-6, 1e-9))
@pytest.mark.parametrize(
    "more",
    (
        {"duration": 1.0},
        {"duration": -2.0, "t0": 2.0},
        {"duration": 1.0, "params": {"mu": 1.001}},
        {"duration": 2.0, "rule": vi.gauss(5)},
    ),
)
def test_both_ways_give_the_same_bytes(monkeypatch, tol, more):
    kepler = scene()
    asked = start(0.98) | more | {"tol": tol}
    long = vi.simulate(kepler, progress=True, **asked)  # a bar is asked for
    monkeypatch.setattr(to_tolerance, "simulate_to_tolerance", never)
    for _ in range(2):  # the second finds its start in place
        short = vi.simulate(kepler, **asked)
        for name in "tqpvkuc":
            assert getattr(short, name).tobytes() == getattr(long, name).tobytes()
        assert short.fictitious.q.tobytes() == long.fictitious.q.tobytes()
        assert list(short.stats) == list(long.stats) and told(short) == told(long)
        times = np.linspace(short.t[0], short.t[-1], 7)
        assert short.at(times).q.tobytes() == long.at(times).q.tobytes()


def crowd() -> vi.System:
    """Two bodies of names of their own, one that hardly moves, an angle, and no parameters."""
    q, v = vi.coordinates("x1", "y1", "x2", "y2", "angle")
    heavy = 50 * ca.sumsqr(v[:2]) + ca.sumsqr(v[2:4]) / 2 + 0.05 * v[4] ** 2
    return vi.System(q, v, heavy + 100 / ca.norm_2(q[:2] - q[2:4]) + 0.1 * ca.cos(q[4]))


@pytest.mark.parametrize("tol", (1e-5, 1e-9))
@pytest.mark.parametrize("duration", (0.4, 40.0))
def test_the_core_and_arrays_tell_the_same_of_runs(monkeypatch, tol, duration):
    """Nodes that are looked at, quantiles, scales and differences: no digit of the error hides."""
    scene, near = crowd(), {"q0": [0, 0, 0.05, 0, 1.0], "v0": [0, 0.1, 0, 61.0, 2.0]}
    long = vi.simulate(scene, progress=True, duration=duration, tol=tol, **near)
    monkeypatch.setattr(to_tolerance, "simulate_to_tolerance", never)
    short = vi.simulate(scene, duration=duration, tol=tol, **near)
    assert short.fictitious is not None and short.q.tobytes() == long.q.tobytes()
    assert told(short) == told(long)


@pytest.mark.parametrize("e", (0.99, 0.999))
def test_growth_beside_a_centre_is_foreseen(e):
    """Differences grow there by so much that what iterations leave would ask for more runs."""
    kepler = scene()
    asked = {"q0": [1 + e, 0.0], "v0": [0.0, np.sqrt((1 - e) / (1 + e))], "duration": 10.0}
    motion, sharp = (vi.simulate(kepler, **asked, tol=tol) for tol in (1e-9, 1e-12))
    assert motion.fictitious is not None and motion.stats["runs"] == 2
    error = np.abs(motion.q[-1] - sharp.q[-1]).max() / 2
    assert error < motion.stats["error_estimate"] < 1e-9


def test_what_one_call_of_the_core_does_not_make_goes_the_long_way(monkeypatch):
    kepler, asked = scene(), start(0.98) | {"duration": 1.0, "tol": 1e-6}
    whole = vi.simulate(kepler, **asked)
    monkeypatch.setattr(varying_call, "varying_runs", lambda *_: NOT_SHORT)
    assert vi.simulate(kepler, **asked).q.tobytes() == whole.q.tobytes()


def test_runs_that_the_core_does_not_prove_are_proved_one_by_one(monkeypatch):
    """And by the same ones, with the same error."""
    kepler, asked = scene(), start(0.98) | {"duration": 1.0, "tol": 1e-6}
    whole = vi.simulate(kepler, **asked)
    monkeypatch.setattr(varying_call, "varying_runs", lambda *_: NOT_PROVED)
    again = vi.simulate(kepler, **asked)
    assert again.q.tobytes() == whole.q.tobytes() and told(again) == told(whole)


def test_where_such_steps_prove_nothing_they_are_not_tried_again(monkeypatch):
    kepler, asked = scene(), start(0.98) | {"duration": 1.0, "tol": 1e-3}
    monkeypatch.setattr(varying_call, "varying_runs", lambda *_: NOT_PROVED)
    monkeypatch.setattr(varying_call, "run_twice", lambda *_: None)
    monkeypatch.setattr(to_tolerance, "choose_varying_steps", never)
    motion = vi.simulate(kepler, **asked)
    assert motion.fictitious is None and motion.stats["error_estimate"] < 1e-3


def test_a_collision_is_refused_in_the_same_words():
    kepler = scene()
    asked = {"q0": [0.1, 0.0], "v0": [0.0, 0.0], "duration": 1.0, "tol": 1e-6}
    said = []
    for progress in (None, True):
        with pytest.raises(vi.ConvergenceError) as refusal:
            vi.simulate(kepler, progress=progress, **asked)
        said.append(str(refusal.value))
    assert said[0] == said[1] and "the motion ends" in said[0]


def test_scenes_whose_rate_varies_little_keep_equal_steps():
    kepler, asked = scene(), start(0.1) | {"duration": 1.0, "tol": 1e-6}
    assert vi.simulate(kepler, **asked).fictitious is None


@pytest.mark.parametrize("every", [3, 10])
def test_every_so_many_nodes_are_kept_that_are_asked_for(every):
    """They were all there, whatever `save_every` said, since their own times lie on no grid."""
    whole = vi.simulate(scene(), **start(0.9), duration=60.0)
    some = vi.simulate(scene(), **start(0.9), duration=60.0, save_every=every)
    kept = np.append(np.flatnonzero(whole.k[:-1] % every == 0), len(whole) - 1)
    assert whole.fictitious is not None and some.fictitious is not None
    for name in ("t", "q", "p", "k"):
        assert getattr(some, name).tobytes() == getattr(whole, name)[kept].tobytes()
    assert some.fictitious.t.tobytes() == whole.fictitious.t[kept].tobytes()
    assert some.at(33.3).q == pytest.approx(whole.at(33.3).q, abs=1e-12)


@pytest.mark.parametrize("progress", [False, True], ids=["core", "Python"])
@pytest.mark.parametrize(
    ("x", "v", "duration"),
    [
        (0.9351644902028533, 0.37832380010563227, 7.003520193278059),
        (0.8787452459042107, 0.35913744939953984, 8.157774305696023),
        (0.8497565015670775, 0.49922244160678225, 8.421740189800442),
    ],
)
def test_a_motion_ends_at_the_time_that_was_asked_for(x, v, duration, progress):
    """To the last digit: it was 1e-14 before, where none could be asked for between its ends."""
    asked = {"q0": [x, 0.0], "v0": [0.0, v], "duration": duration, "tol": 1e-3}
    motion = vi.simulate(vi.models.kepler().system, **asked, progress=progress)
    assert motion.fictitious is not None and motion.t[-1] == duration
    between = motion.at(np.linspace(0, duration, 7))
    assert np.abs(between.q[-1] - motion.q[-1]).max() < 1e-12


@pytest.mark.parametrize("duration", [9.0, -9.0])
def test_times_between_nodes_are_found_at_once_as_one_round_after_the_other(monkeypatch, duration):
    motion = vi.simulate(scene(), **start(0.9), duration=duration, t0=2.0)
    times = 2.0 + duration * np.random.default_rng(1).uniform(0, 1, 40)  # in any order
    times[:3] = motion.t[[0, -1, len(motion) // 2]]
    at_once = motion.at(times)
    monkeypatch.setattr(physical_time, "_reach_at_once", lambda *_: None)
    slowly = motion.at(times)
    assert np.abs(at_once.q - slowly.q).max() < 1e-13
    assert np.abs(at_once.v - slowly.v).max() < 1e-11
    assert (at_once.k == slowly.k).all()
    assert (motion[::3].at(times[:5]).t == times[:5]).all()  # nodes more than a step apart
