"""Runs with steps whose solution hangs on the last bit end alike whatever loop was asked for."""

from functools import cache

import casadi as ca
import numpy as np
import pytest

import varint as vi

pytestmark = [pytest.mark.filterwarnings("ignore::UserWarning")]

RULES = vi.gauss(3), vi.lobatto(4)
SCENES = {
    "duffing": (1, lambda q, v, a, b: v**2 / 2 - a * q**2 - b * q**4),
    "morse": (1, lambda q, v, a, b: v**2 / 2 - a * (1 - ca.exp(-q)) ** 2 - 1e-3 * b * q**2),
    "springs": (
        2,
        lambda q, v, a, b: (
            ca.sumsqr(v) / 2 - a * (ca.sqrt(ca.sumsqr(q) + 0.01) - 1) ** 2 - 0.01 * b * q[1]
        ),
    ),
    "turning": (
        2,
        lambda q, v, a, b: (
            (v[0] ** 2 + v[1] ** 2 * (1 + q[0] ** 2)) / 2 - a * ca.sumsqr(q) / 2 - b * q[1] ** 4
        ),
    ),
}


@cache
def scene(name, damped):
    n, lagrangian = SCENES[name]
    q, v = vi.coordinates(*"xy"[:n])
    c = vi.Parameters(a=1.0, b=1.0)
    force = {"force": -0.5 * v} if damped else {}
    return vi.System(q, v, lagrangian(q, v, c.a, c.b), params=c, **force)


def end(name, damped, rule, backend, **run):
    """The nodes, and the step that could not be done."""
    try:
        return vi.simulate(scene(name, damped), rule, **run, steps=100, backend=backend), None
    except vi.ConvergenceError as error:
        return error.trajectory, error.step


def drawn(rng, name):
    n = SCENES[name][0]
    a, b, h = 10 ** rng.uniform((1, 0, -2.3), (5, 5, -0.3))
    params = {"a": float(a), "b": float(b)}
    return dict(q0=rng.uniform(0.3, 2, n), v0=10 * rng.normal(size=n), h=float(h), params=params)


@pytest.mark.parametrize("name", ["morse", "springs", "turning"])
def test_stiff_scenes_drawn_at_random_end_alike(name):
    """Of 500 such cases 30 ended at other steps, or in one loop alone, when each did its own."""
    rng, failed = np.random.default_rng(len(name)), 0
    for i in range(10):
        case = name, name == "turning", RULES[i % 2]
        run = drawn(rng, name)
        (motion, step), (other, same) = (
            end(*case, backend, **run) for backend in ("interpreted", "native")
        )
        assert step == same
        assert len(motion) == len(other)
        failed += step is not None
    assert 0 < failed < 10


def test_runs_that_one_loop_alone_could_not_end_are_done_by_one_loop():
    """Start values of Newton's method from other steps led elsewhere (hω = 6 to 30)."""
    for rule, a, b, h, q0, v0 in (
        (vi.gauss(3), 61.49999399642615, 45627.54649490872, 0.015409657520902799, 0.55, -5.56),
        (vi.gauss(3), 114.18395443530972, 5082.253278559777, 0.12727162338627, 0.9525, 0.77),
        (vi.gauss(4), 118.7928757532486, 92005.02214987214, 0.12323320680187, 0.74, -27.2),
    ):
        run = dict(q0=q0, v0=v0, h=h, params={"a": a, "b": b})
        (motion, step), (other, same) = (
            end("duffing", False, rule, backend, **run) for backend in ("interpreted", "native")
        )
        assert step == same
        assert motion.q.tobytes() == other.q.tobytes()


def test_steps_that_resolve_their_motion_are_interpreted():
    """No iteration of theirs takes long, and another loop differs by round-off alone."""
    run = dict(q0=1.0, v0=0.0, h=0.01, params={"a": 50.0, "b": 10.0})
    (motion, _), (other, _) = (
        end("duffing", False, vi.gauss(3), backend, **run) for backend in ("interpreted", "native")
    )
    assert motion.stats["backend"] == "interpreted"
    assert other.stats["backend"] != "interpreted"
    assert 0 < np.abs(motion.q - other.q).max() < 1e-12


def test_a_run_that_was_taken_over_goes_on_from_its_checkpoint(tmp_path, monkeypatch):
    """With the bytes of one that was not stopped."""
    monkeypatch.setattr("varint.integration.checkpoint.PAUSE", 0.0)
    monkeypatch.setattr("varint.integration.checkpoint.MOST_SHARE", 1e9)
    run = dict(q0=1.0, v0=0.0, h=0.12, params={"a": 50.0, "b": 10.0}, backend="interpreted")
    system, rule, file = scene("duffing", False), vi.gauss(2), tmp_path / "run"
    whole = vi.simulate(system, rule, **run, steps=4000)
    assert whole.stats["backend"] != "interpreted"

    from varint.integration import compiled_loop

    real, calls = compiled_loop.compiled_run, []

    def stopped(*args, **options):
        calls.append(1)
        if len(calls) == 4:
            raise KeyboardInterrupt
        return real(*args, **options)

    monkeypatch.setattr(compiled_loop, "PATIENCE", 1e-4)
    monkeypatch.setattr(compiled_loop, "compiled_run", stopped)
    part = vi.simulate(system, rule, **run, steps=4000, checkpoint=file)
    assert part.stats["interrupted"] and 1 < len(part) < 4001
    monkeypatch.setattr(compiled_loop, "compiled_run", real)
    again = vi.simulate(system, rule, **run, steps=4000, checkpoint=file)
    assert again.q.tobytes() == whole.q.tobytes()
    assert again.stats["backend"] == whole.stats["backend"]


@pytest.mark.parametrize("angle", [0.0, 1e-3])
@pytest.mark.parametrize("backend", ["native", "compiled"])
def test_a_stiff_spring_that_hardly_pushes_along_itself_is_iterated_to_its_last_digit(
    angle, backend
):
    """Its length's last digit times its stiffness is much beside the small force along it at the
    start: this was taken for an iteration that does not come to its end.
    """
    q, v = vi.coordinates("x", "y")
    stretched = ca.norm_2(q) - 1
    system = vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[1] - 1e6 * stretched**2 / 2)
    start = dict(q0=[np.cos(angle), np.sin(angle)], v0=[0.0, 0.0])
    steps = 16384
    motion = vi.simulate(system, vi.gauss(8), **start, h=10 / steps, steps=steps, backend=backend)
    assert motion.stats["iterations"] > 3 * steps  # Newton's method takes hardly more than one
    assert abs(motion.energy - motion.energy[0]).max() < 1e-13
