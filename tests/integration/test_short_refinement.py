"""Scenes with forces or explicit time: short runs prove their errors, as `refine` would."""

import warnings

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.codegen.two_runs import NOT_PROVED, NOT_SHORT
from varint.integration import short_call, short_doubts, tolerance
from varint.integration.energy_check import energies_along, energies_by_velocity
from varint.integration.looks_between import looked_at_closely
from varint.integration.problem import RunOptions, Start, initial_value_problem
from varint.integration.run import short_run
from varint.integration.short_refinement import by_short_refinement
from varint.integration.short_trials import by_short_trials
from varint.integration.small_motions import small_motions_at_start


def damped() -> tuple[vi.System, dict, object]:
    q, v = vi.coordinates("x")
    scene = vi.System(q, v, v**2 / 2 - q**2 / 2, force=-0.2 * v)
    w = np.sqrt(1 - 0.01)
    return (
        scene,
        {"q0": 1.0, "v0": -0.1},
        lambda t: np.exp(-0.1 * t)[:, None] * np.cos(w * t)[:, None],
    )


def driven() -> tuple[vi.System, dict, object]:
    q, v = vi.coordinates("x")
    t = vi.time()
    scene = vi.System(q, v, v**2 / 2 - 2 * q**2, force=3 * ca.cos(t), t=t)
    return scene, {"q0": 1.0, "v0": 2.0}, lambda t: (np.cos(t) + np.sin(2 * t))[:, None]


def dragged() -> tuple[vi.System, dict, object]:
    """m a = −k |v| v along a line: x = ln(1 + k v₀ t)/k."""
    q, v = vi.coordinates("x", "y", "z")
    k, along = 0.05, np.array([2.0, 3.0, 6.0]) / 7
    scene = vi.System(q, v, ca.sumsqr(v) / 2, force=-k * ca.norm_2(v) * v)
    found = lambda t: np.log(1 + k * 60 * t)[:, None] / k * along  # noqa: E731
    return scene, {"q0": np.zeros(3), "v0": 60 * along}, found


def growing() -> tuple[vi.System, dict, object]:
    """d/dt((1 + t/2) v) = −g (1 + t/2): a mass that grows while it falls."""
    q, v = vi.coordinates("y")
    t = vi.time()
    m = 1 + t / 2
    scene = vi.System(q, v, m * v**2 / 2 - 9.81 * m * q, t=t)

    def found(t):
        grown = 2 * np.log1p(t / 2)
        return (grown - 9.81 * (t + t**2 / 4 - grown))[:, None]

    return scene, {"q0": 0.0, "v0": 1.0}, found


SCENES = {"damped": damped, "driven": driven, "dragged": dragged, "growing": growing}


def never(*_, **__):
    raise AssertionError("the long way is taken")


@pytest.mark.parametrize("tol", (1e-4, 1e-9, 1e-12))
@pytest.mark.parametrize("duration", (0.1, 12.0))
@pytest.mark.parametrize("name", SCENES)
def test_short_runs_keep_the_promise(monkeypatch, name, duration, tol):
    scene, start, exact = SCENES[name]()
    monkeypatch.setattr(tolerance, "refine", never)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        motion = vi.simulate(scene, **start, duration=duration, tol=tol)
    true = exact(motion.t)
    scales = np.ptp(true, axis=0)
    error = np.abs((motion.q - true) / scales).max()
    assert error <= max(motion.stats["error_estimate"], 2e-14)  # round-off of the closed form
    assert motion.stats["error_estimate"] <= tol
    assert motion.t[-1] == pytest.approx(duration)


@pytest.mark.parametrize("name", SCENES)
def test_so_many_steps_give_the_same_bytes_the_long_way(monkeypatch, name):
    scene, start, _ = SCENES[name]()
    motion = vi.simulate(scene, **start, duration=5.0, tol=1e-4)
    found, steps = [], motion.stats["steps"]
    monkeypatch.setattr(short_call, "proved_motion", lambda: lambda *_: NOT_PROVED)
    monkeypatch.setattr(tolerance, "by_short_trials", lambda *_: NOT_PROVED)

    def watched(*given):
        found.append(short_run(*given))
        return found[-1]

    def begun(*search):
        search[5](search[1], steps)
        raise StopIteration

    monkeypatch.setattr(tolerance, "short_run", watched)
    monkeypatch.setattr(tolerance, "refine", begun)
    with pytest.raises(StopIteration):
        vi.simulate(scene, **start, rule=motion.rule, duration=5.0, tol=1e-4)
    (long,) = found
    if scene.structure.linear:  # by one map a step here, and solves of its equations there
        assert "one linear map" in motion.stats["backend"]
        assert np.abs(motion.q - long.q).max() <= 1e-13 * np.abs(long.q).max()
        assert np.abs(motion.p - long.p).max() <= 1e-13 * np.abs(long.p).max()
        return
    for each in "tqpk":
        assert getattr(motion, each).tobytes() == getattr(long, each).tobytes()


def swung() -> tuple[vi.System, dict, object]:
    """A pendulum with friction on a support that shakes, and two springs side by side."""
    q, v = vi.coordinates("theta", "x", "y")
    t = vi.time()
    energy = v[0] ** 2 / 2 + ca.sumsqr(v[1:]) + (3 + ca.cos(4 * t)) * ca.cos(q[0])
    force = ca.vertcat(-0.1 * v[0], -0.3 * v[1] * ca.norm_2(v[1:]) + ca.sin(2 * t), 0.2 * q[0])
    scene = vi.System(q, v, energy - 4 * ca.sumsqr(q[1:]) ** 2, force=force, t=t)
    return scene, {"q0": [2.0, 0.5, 0.1], "v0": [0.0, 0.3, -0.2]}, None


def double_well() -> tuple[vi.System, dict, object]:
    """Chaotic: errors grow by e every four time units."""
    q, v, t = *vi.coordinates("x"), vi.time()
    force = -0.13 * v + 0.24 * ca.cos(0.9 * t)
    return (
        vi.System(q, v, v**2 / 2 + q**2 / 2 - q**4 / 4, force=force, t=t),
        {"q0": -0.7, "v0": -0.7},
        None,
    )


@pytest.mark.parametrize("tol", (1e-4, 1e-9, 1e-12))
@pytest.mark.parametrize("duration", (-3.0, 0.2, 20.0, 60.0))
@pytest.mark.parametrize("name", ("dragged", "growing", "swung", "well"))
def test_the_core_decides_as_python_does(name, duration, tol):
    scene, start, _ = (SCENES | {"swung": swung, "well": double_well})[name]()
    asked = Start(np.atleast_1d(start["q0"]), np.atleast_1d(start["v0"]), t0=0.5)
    options, rule, radians = RunOptions(steps=1, duration=duration), vi.gauss(8), 2 * abs(duration)
    problem = initial_value_problem(scene, rule, asked, options)
    mass = small_motions_at_start(scene, problem.q0, problem.p0, problem.t0, problem.c)[1]
    one = by_short_trials(scene, rule, problem, mass, tol, (radians, radians), "auto", 0.0)
    other = by_short_refinement(scene, rule, problem, tol, radians, None, "auto")
    if other is None:
        assert one in (NOT_PROVED, NOT_SHORT)  # what is longer than it may be is left to Python
        return
    assert (one.steps, one.runs, one.reached) == (other.steps, other.runs, other.reached)
    assert one.estimate == pytest.approx(other.estimate, rel=1e-9)
    for each in "tqpk":
        assert getattr(one.motion, each).tobytes() == getattr(other.motion, each).tobytes()


@pytest.mark.parametrize("when", (3.3, 7.05))
def test_what_the_core_doubts_is_looked_at_closely(monkeypatch, when):
    """A pulse that all runs step over: bounds of the force tell the core that it may be there."""
    q, v, t = *vi.coordinates("x"), vi.time()
    push = 0.1 * ca.exp(-(((t - when) / 1e-3) ** 2))
    scene = vi.System(q, v, v**2 / 2 - q**4 / 4, force=push, t=t)
    looked = []

    def closely(*given):
        looked.append(looked_at_closely(*given))
        return looked[-1]

    monkeypatch.setattr(short_doubts, "looked_at_closely", closely)
    tol = 1e-6
    motion = vi.simulate(scene, q0=1.0, v0=0.0, duration=10.0, tol=tol)
    assert looked and looked[0] > tol
    monkeypatch.setattr(short_call, "proved_motion", lambda: lambda *_: NOT_PROVED)
    long = vi.simulate(scene, q0=1.0, v0=0.0, duration=10.0, tol=1e-9)
    assert abs(motion.q[-1] - long.q[-1]) <= 2 * tol * np.ptp(long.q)


@pytest.mark.parametrize("mu", (0.1, 0.2, 0.3, 0.5))
def test_estimates_stay_above_errors_where_orders_have_not_settled(mu):
    """Friction that bends sharply at v = 0: how runs come together changes from one to the next."""
    q, v, t = *vi.coordinates("x"), vi.time()
    w = ca.SX.sym("w")
    force = -mu * v * ca.sqrt(v**2 + 0.01) + ca.cos(w * t)
    scene = vi.System(q, v, v**2 / 2 - q**2 / 2, force=force, t=t, params={w: 2.0})
    for frequency in (0.7, 1.7, 2.3, 3.1):
        for duration in (2.0, 4.5, 7.0, 11.0):
            asked = {"q0": 1.0, "v0": 0.2, "duration": duration, "params": {"w": frequency}}
            motion = vi.simulate(scene, **asked)
            steps = motion.stats["steps"]
            finer = -(-2000 // steps)
            fine = vi.simulate(scene, vi.gauss(8), **asked, steps=steps * finer)
            q = fine.q[::finer] if motion.sizes is None else fine.at(motion.t).q
            error = np.abs(motion.q - q).max() / np.ptp(fine.q)
            assert error <= motion.stats["error_estimate"] + 1e-14 <= 1.1e-9


def test_what_short_runs_do_not_settle_goes_the_long_way(monkeypatch):
    scene, start, exact = driven()
    asked = start | {"duration": 5.0, "tol": 1e-8}
    taken = []
    monkeypatch.setattr(short_call, "proved_motion", lambda: lambda *_: NOT_SHORT)
    monkeypatch.setattr(tolerance, "by_short_trials", lambda *_: NOT_SHORT)
    monkeypatch.setattr(tolerance, "by_short_refinement", lambda *_: taken.append(1))
    motion = vi.simulate(scene, **asked)
    assert taken and np.abs(motion.q - exact(motion.t)).max() < 1e-7


def test_a_pulse_between_nodes_is_not_passed_over_by_short_runs():
    q, v = vi.coordinates("x")
    t = vi.time()
    width = 1e-3
    push = ca.exp(-(((t - 3.3) / width) ** 2)) / (width * np.sqrt(np.pi))
    scene = vi.System(q, v, v**2 / 2, force=push - 1e-3 * v, t=t)
    motion = vi.simulate(scene, q0=0.0, v0=0.0, duration=10.0, tol=1e-6)
    k = 1e-3
    end = (1 - np.exp(-k * 6.7)) / k  # of a unit impulse; its width is below a part in 10⁶
    assert motion.q[-1, 0] == pytest.approx(end, rel=1e-5)


def test_few_nodes_that_bound_the_work_poorly_raise_no_false_alarm():
    """A support that shakes three times as fast as the nodes are apart."""
    q, v = vi.coordinates("theta")
    t = vi.time()
    scene = vi.System(q, v, v**2 / 2 + (1 + ca.cos(10 * t)) * ca.cos(q), t=t)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        motion = vi.simulate(scene, q0=0.3, v0=0.5, duration=3.0, tol=1e-9)
    fine = vi.simulate(scene, vi.gauss(8), q0=0.3, v0=0.5, duration=3.0, steps=256)
    assert abs(motion.q[-1] - fine.q[-1]).max() < 1e-9


def test_energies_by_velocities_are_those_by_momenta():
    q, v = vi.coordinates("x", "y")
    scene = vi.System(q, v, -ca.sqrt(1 - ca.sumsqr(v)) - ca.sumsqr(q) / 2 + q[0] * v[1])
    motion = vi.simulate(scene, q0=[0.4, 0.1], v0=[0.0, 0.3], h=0.1, steps=40)
    rows = np.stack([motion.q, motion.p, motion.v], axis=1)
    one = energies_by_velocity(scene, rows, motion.t[:1], motion.c)
    other = energies_along(scene, motion.q, motion.p, motion.t[:1], motion.c)
    for a, b in zip(one, other, strict=True):
        assert np.abs(a - b).max() < 1e-14
    assert np.abs(one[0] - motion.energy).max() < 1e-14


def driven_pendulum() -> tuple[vi.System, dict]:
    """Close to chaos: what iterations leave is magnified, and parts runs more than steps do."""
    (q, v), t = vi.coordinates("a"), vi.time()
    force = 1.15 * ca.cos(2 * t / 3) - v / 2
    return vi.System(q, v, v**2 / 2 + ca.cos(q), t=t, force=force), {"q0": 0.2, "v0": 0.0}


@pytest.mark.parametrize("events", (False, True))
def test_iterations_of_loose_tolerances_do_not_part_runs(events):
    """What is wanted less exactly takes no more steps: 180 for 1e-3 where 90 did for 1e-6."""
    scene, start = driven_pendulum()
    watched = {"events": {"top": scene.q - 3.0}} if events else {}
    steps = [
        vi.simulate(scene, **start, duration=40.0, tol=tol, progress=False, **watched).stats[
            "steps"
        ]
        for tol in (1e-3, 1e-4, 1e-6)
    ]
    assert steps[0] <= 45
    assert steps == sorted(steps)


def test_runs_are_followed_by_those_that_prove_them():
    """Stages say that half as many steps more do: 50, 75 in the place of 60, 90 or 60, 120."""
    scene, start = driven_pendulum()
    asked = {**start, "duration": 40.0, "progress": False}
    found = vi.simulate(scene, **asked, tol=1e-9)
    assert (found.stats["steps"], found.stats["runs"]) == (75, 3)
    exact = vi.simulate(scene, **asked, tol=1e-12)
    assert np.abs(found.q[-1] - exact.q[-1]).max() <= 1e-9 * np.abs(exact.q).max()
