"""Default calls whose steps follow the scene over forces and explicit time."""

import warnings

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.codegen.two_runs import NOT_PROVED, NOT_SHORT
from varint.integration import short_trials, to_tolerance
from varint.integration.error_scale import error_scales
from varint.integration.time_transformation import varying_call
from varint.integration.time_transformation.time_signals import signals_of

q, v = vi.coordinates("x", "y")
T = vi.time()
R = ca.norm_2(q)
KEPLER = ca.sumsqr(v) / 2 + 1 / R
LED = 0.05 * ca.vertcat(ca.cos(0.7 * T) - 1, ca.sin(0.7 * T))
SCENES = {
    "drag": vi.System(q, v, KEPLER, force=-0.001 * v),
    "air": vi.System(q, v, KEPLER, force=-0.01 * ca.exp(-5 * R) * ca.norm_2(v) * v),
    "a drive": vi.System(q, v, KEPLER + 0.05 * q[0] * ca.cos(2 * T), t=T),
    "a led sun": vi.System(q, v, ca.sumsqr(v) / 2 + 1 / ca.norm_2(q - LED), force=-0.01 * v, t=T),
    "light": vi.System(q, v, KEPLER, force=0.1 * q / R**3 - 1e-5 * v / R**2),
}


def orbit(e, angle=0.0):
    """From an anomaly of an orbit whose longer half-axis is one."""
    p = 1 - e * e
    q0 = p / (1 + e * np.cos(angle)) * np.array([np.cos(angle), np.sin(angle)])
    return {"q0": q0, "v0": np.array([-np.sin(angle), e + np.cos(angle)]) / np.sqrt(p)}


def error_of(motion, start):
    """At all nodes, beside short steps that follow the scene."""
    asked = start | {"h": 0.15, "duration": motion.duration, "time_scale": "auto"}
    true = vi.simulate(motion.system, vi.gauss(10), **asked, t0=motion.t[0])
    off = np.abs(motion.q - true.at(motion.t).q)
    return float((off / error_scales(motion.system, motion, None)).max())


@pytest.mark.parametrize("tol", (1e-3, 1e-6, 1e-9))
@pytest.mark.parametrize("name", SCENES)
def test_the_error_is_below_the_estimate_and_that_below_tol(name, tol):
    rng = np.random.default_rng(len(name))
    for _ in range(3):
        start = orbit(1 - 10 ** rng.uniform(-2, -1), rng.uniform(-3, 3))
        motion = vi.simulate(SCENES[name], **start, duration=float(rng.uniform(7, 20)), tol=tol)
        assert motion.fictitious is not None and len(motion) < 400
        assert error_of(motion, start) < motion.stats["error_estimate"] + 1e-12 <= tol + 1e-12


def test_a_bump_on_the_way_is_no_surprise():
    """Of a force that does no work the energies of runs tell nothing."""
    rng = np.random.default_rng(5)
    for width in (0.05, 0.1, 0.3):
        at = rng.normal(size=2) / 2
        bump = ca.exp(-ca.sumsqr(q - at) / width**2) * ca.vertcat(-v[1], v[0])
        system, start = vi.System(q, v, KEPLER, force=0.3 * bump), orbit(0.95, rng.uniform(-3, 3))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            motion = vi.simulate(system, **start, duration=15.0, tol=1e-6)
        assert error_of(motion, start) < motion.stats["error_estimate"]


def never(*_, **__):
    raise AssertionError("the long way is taken")


def told(motion):
    return {k: x for k, x in motion.stats.items() if k not in ("seconds", "plan", "backend")}


@pytest.mark.parametrize("name", SCENES)
def test_both_ways_give_the_same_bytes(monkeypatch, name):
    asked = orbit(0.97) | {"duration": 7.0, "tol": 1e-8, "t0": 0.5}
    long = vi.simulate(SCENES[name], progress=True, **asked)
    monkeypatch.setattr(to_tolerance, "simulate_to_tolerance", never)
    short = vi.simulate(SCENES[name], **asked)
    for part in "tqpvkuc":
        assert getattr(short, part).tobytes() == getattr(long, part).tobytes()
    assert told(short) == told(long)


@pytest.mark.parametrize("said", (NOT_SHORT, NOT_PROVED))
def test_runs_that_the_core_does_not_prove_are_proved_one_by_one(monkeypatch, said):
    asked = orbit(0.97) | {"duration": 7.0, "tol": 1e-8}
    whole = vi.simulate(SCENES["a led sun"], **asked)
    monkeypatch.setattr(varying_call, "varying_runs", lambda *_: said)
    again = vi.simulate(SCENES["a led sun"], **asked)
    assert again.q.tobytes() == whole.q.tobytes() and told(again) == told(whole)


@pytest.mark.parametrize("halves", (True, False))
def test_an_encounter_that_nothing_showed_is_followed_nevertheless(monkeypatch, halves):
    """It is deep, and further ahead than a look reaches: steps are halved there. If they were not,
    they would follow it after runs that take a hundred times as long.
    """
    drag = 0.05 if halves else 0.05 + 1e-15  # not made alike: it has runs of its own
    if not halves:
        limits = short_trials._REFINED.copy()
        limits[-5] = 1e9  # runs that are lost before
        monkeypatch.setattr(short_trials, "_REFINED", limits)
    twins = ca.sqrt(ca.sumsqr(q - ca.DM([0.3, 0]))), ca.sqrt(ca.sumsqr(q + ca.DM([0.3, 0])))
    system = vi.System(q, v, ca.sumsqr(v) / 2 + sum(0.5 / r for r in twins), force=-drag * v)
    start = {"q0": [1.2, 0.3], "v0": [-0.1, 0.4]}
    motion = vi.simulate(system, **start, duration=10.0, tol=1e-6)
    assert (motion.fictitious is None) == (motion.sizes is not None) == halves
    assert len(motion) < 300
    assert error_of(motion, start) < motion.stats["error_estimate"] <= 1e-6


def test_pulses_in_time_are_left_to_equal_steps():
    pulse = ca.exp(-(((T - 2.0) / 0.01) ** 2)) * q[0]
    system = vi.System(q, v, KEPLER + pulse, t=T)
    assert signals_of(system).rate is None
    motion = vi.simulate(system, **orbit(0.9), duration=6.0, tol=1e-6)
    assert motion.fictitious is None
    fine = vi.simulate(system, vi.gauss(8), **orbit(0.9), duration=6.0, steps=40_000)
    assert np.abs(motion.q[-1] - fine.q[-1]).max() < motion.stats["error_estimate"]


def test_signals_are_as_fast_as_their_waves():
    c = vi.Parameters(w=3.0)
    drive = ca.cos(c.w * T) * ca.sin(2 * T) + ca.exp(-0.5 * T) + T**2
    found = signals_of(vi.System(q, v, KEPLER + drive * q[0], params=c, t=T))
    assert found.values.numel() == 1
    assert float(ca.evalf(ca.substitute(found.rate, c.w, 3.0))) == 5.0
    assert signals_of(SCENES["drag"]).rate.is_zero()


@pytest.mark.parametrize("e", (0.1, 0.5))
def test_motions_whose_rate_varies_little_keep_equal_steps(e):
    assert vi.simulate(SCENES["drag"], **orbit(e), duration=7.0).fictitious is None
    well = vi.System(q, v, ca.sumsqr(v) / 2 - ca.sumsqr(q) ** 2 / 4, force=-0.01 * v)
    assert vi.simulate(well, **orbit(e), duration=7.0).fictitious is None


def test_polar_coordinates_follow_the_speed_that_is_left():
    r, w = vi.coordinates("r", "phi")
    kinetic = w[0] ** 2 / 2 + r[0] ** 2 * w[1] ** 2 / 2
    system = vi.System(r, w, kinetic + 1 / r[0], force=-0.001 * ca.vertcat(w[0], r[0] ** 2 * w[1]))
    e = 0.97
    start = {"q0": [1 - e, 0.0], "v0": [0.0, np.sqrt((1 + e) / (1 - e)) / (1 - e)]}
    motion = vi.simulate(system, **start, duration=7.0, tol=1e-8)
    flat = vi.simulate(SCENES["drag"], **orbit(e), duration=7.0, tol=1e-11)
    x, y = flat.q[-1]
    assert motion.fictitious is not None and len(motion) < 300
    assert abs(motion.q[-1, 0] - np.hypot(x, y)) < 1e-7
    assert abs(np.exp(1j * motion.q[-1, 1]) - (x + 1j * y) / np.hypot(x, y)) < 1e-7


def spiral():
    """To the centre in about 20 time units, and no end of turns."""
    q, v = vi.coordinates("x", "y")
    r, speed = ca.sqrt(ca.sumsqr(q)), ca.sqrt(ca.sumsqr(v))
    scene = vi.System(q, v, speed**2 / 2 + 1 / r, force=-0.05 * v * speed)
    return scene, dict(q0=[1.0, 0.0], v0=[0.0, 1.0])


def test_a_spiral_that_turns_ever_faster_is_looked_at_in_few_pieces(monkeypatch):
    """The clock falls behind its mean rate all along: pieces of a run were ever shorter, and the
    whole of it was looked at after each. Of 200,000 steps that took 26 s, and takes half a second.
    """
    from varint.integration.time_transformation import physical_end

    look, looks = physical_end.trajectory_of, []

    def counted(run, nodes):
        looks.append(run)
        assert len(looks) < 500
        return look(run, nodes)

    monkeypatch.setattr(physical_end, "trajectory_of", counted)
    scene, start = spiral()
    motion, other = (vi.simulate(scene, **start, duration=19.9, tol=tol) for tol in (1e-9, 1e-10))
    assert motion.stats["error_estimate"] <= 1e-9
    assert motion.q[-1] == pytest.approx(other.q[-1], abs=2e-10)


def test_a_spiral_ends_where_it_has_no_end_of_turns():
    """Asked for beyond the centre: it had no end after 145 s."""
    scene, start = spiral()
    with pytest.raises(vi.ConvergenceError, match="ever faster") as told:
        vi.simulate(scene, **start, duration=40.0)
    found, before = told.value.trajectory, vi.simulate(scene, **start, duration=15.0)
    radius = np.linalg.norm(found.q, axis=1)
    assert told.value.time == found.t[-1] == pytest.approx(20.0, abs=0.1)
    assert radius[-1] < 1e-3
    assert np.interp(15.0, found.t, radius) == pytest.approx(np.hypot(*before.q[-1]), abs=1e-3)
