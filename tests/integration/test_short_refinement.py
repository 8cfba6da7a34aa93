"""Scenes with forces or explicit time: short runs prove their errors, as `refine` would."""

import warnings

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.integration import tolerance
from varint.integration.energy_check import energies_along, energies_by_velocity
from varint.integration.run import short_run


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
    motion = vi.simulate(scene, **start, duration=5.0, tol=1e-7)
    found, steps = [], motion.stats["steps"]
    monkeypatch.setattr(tolerance, "by_short_refinement", lambda *_: None)

    def watched(*given):
        found.append(short_run(*given))
        return found[-1]

    def begun(*search):
        search[5](search[1], steps)
        raise StopIteration

    monkeypatch.setattr(tolerance, "short_run", watched)
    monkeypatch.setattr(tolerance, "refine", begun)
    with pytest.raises(StopIteration):
        vi.simulate(scene, **start, rule=motion.rule, duration=5.0, tol=1e-7)
    (long,) = found
    for each in "tqpk":
        assert getattr(motion, each).tobytes() == getattr(long, each).tobytes()


def test_what_short_runs_do_not_settle_goes_the_long_way(monkeypatch):
    scene, start, exact = driven()
    asked = start | {"duration": 5.0, "tol": 1e-8}
    taken = []
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
