"""Scenes whose dampers are stiff: what they stop at once takes no steps."""

import warnings

import casadi as ca
import numpy as np
import pytest
from scenes import damped_beam, resting_chain
from scipy.integrate import solve_ivp

import varint as vi
import varint.multibody as mb
from varint.integration.damped_motions import (
    FAST,
    STIFF,
    are_stiff,
    damped_turns,
    has_slopes_without,
    look_function,
    may_be_damped,
)
from varint.integration.times_at_once import states_by_core
from varint.numerics.arrays import call
from varint.results import dense_output


def line(stiffness: float, damping: float, many: int = 7, bent: float = 0.0) -> vi.System:
    """Springs and dampers in a line of unit masses, held at its left end."""
    q, v = vi.coordinates(*[f"x{i}" for i in range(many)])
    bends, rates = q - ca.vertcat(0, q[:-1]), v - ca.vertcat(0, v[:-1])
    push = -damping * (rates - ca.vertcat(rates[1:], 0))
    energy = stiffness / 2 * ca.sumsqr(bends) + bent * ca.sum1(bends**4)
    return vi.System(q, v, ca.sumsqr(v) / 2 - energy, force=push)


def rates_of(stiffness: float, damping: float, many: int) -> np.ndarray:
    """Of all its modes: λ² + c μ λ + k μ = 0 with μ = 4 sin²((2i − 1) π / (4n + 2))."""
    part = 4 * np.sin((2 * np.arange(many) + 1) * np.pi / (4 * many + 2)) ** 2
    return np.array([np.roots([1, damping * x, stiffness * x]) for x in part])


@pytest.mark.parametrize("damping", (0.3, 20.0, 300.0))
@pytest.mark.parametrize("many", (2, 3, 7))
def test_what_lasts_and_what_is_fastest_are_those_of_the_modes(damping, many):
    stiffness, duration = 100.0, 5.0
    system = line(stiffness, damping, many, bent=1.0)
    rates = rates_of(stiffness, damping, many)
    frequency = np.sqrt(np.abs(rates[:, 0] * rates[:, 1]).max())
    still, c = np.zeros(many), system.default_vector
    local = np.concatenate(call(look_function(system), still, still, np.zeros(1), c))
    fastest = np.abs(rates.sum(axis=1)).max()  # γ of v' = −γ v, without springs
    stiff = fastest > max(STIFF * frequency, FAST / duration)
    assert are_stiff(local, many, duration, frequency * duration) == stiff
    lasts, fast = damped_turns(system, still, still, 0.0, c, duration)
    slow = np.abs(rates[-rates.real * duration < 20]).max(initial=0.0)
    assert lasts == pytest.approx(slow * duration, rel=1e-6)
    assert fast == pytest.approx(np.abs(rates).max() * duration, rel=1e-6)
    back = damped_turns(system, still, still, 0.0, c, -duration)
    assert back == pytest.approx((fast, fast), rel=1e-12)


def test_linear_scenes_and_those_without_dampers_are_not_looked_at():
    assert may_be_damped(line(1.0, 1.0, bent=1.0))
    assert not may_be_damped(line(1.0, 0.0, bent=1.0))
    assert not may_be_damped(line(1.0, 1.0))
    one, t = line(1.0, 1.0, bent=1.0), vi.time()
    force = one.force + ca.vertcat(ca.sin(t), ca.SX(6, 1))
    assert may_be_damped(vi.System(one.q, one.v, one.lagrangian, force=force, t=t))


@pytest.mark.parametrize("tol", (1e-3, 1e-6, 1e-9))
@pytest.mark.parametrize("damping", (50.0, 1000.0, 3e4))
def test_an_overdamped_spring_takes_few_steps_and_keeps_the_promise(tol, damping):
    """2,048 steps at 1e-9 with a damping of 1,000 before, 16,384 with one of 5,000 in a pair."""
    q, v = vi.coordinates("x")
    system = vi.System(q, v, v**2 / 2 - 2 * q**2 - q**4 / 4, force=-damping * v)
    motion = vi.simulate(system, q0=[1.0], v0=[0.0], duration=10.0, tol=tol)
    assert len(motion) < 200 and motion.stats["error_estimate"] <= tol

    def rates(t, y):
        return [y[1], -4 * y[0] - y[0] ** 3 - damping * y[1]]

    exact = solve_ivp(rates, (0, 10), [1.0, 0.0], "Radau", t_eval=motion.t, rtol=1e-12, atol=1e-14)
    assert np.abs(motion.q[:, 0] - exact.y[0]).max() < tol


@pytest.mark.parametrize("tol", (1e-3, 1e-6, 1e-9))
def test_a_relaxation_that_begins_damped_goes_on_by_its_frequency(tol):
    """Van der Pol's: a damper of sixty a second at the start drives it where it passes zero."""
    q, v = vi.coordinates("x")
    system = vi.System(q, v, v**2 / 2 - q**2 / 2, force=20 * (1 - q**2) * v)
    motion = vi.simulate(system, q0=[2.0], v0=[0.0], duration=40.0, tol=tol)
    assert motion.stats["error_estimate"] <= tol
    exact = solve_ivp(
        lambda t, y: [y[1], 20 * (1 - y[0] ** 2) * y[1] - y[0]],
        (0, 40),
        [2.0, 0.0],
        "DOP853",
        t_eval=motion.t,
        rtol=1e-13,
        atol=1e-13,
    )
    assert np.abs(motion.q[:, 0] - exact.y[0]).max() < 2 * tol


@pytest.mark.parametrize("tol", (1e-3, 1e-6, 1e-9))
def test_a_damped_beam_takes_few_steps_and_keeps_the_promise(tol):
    """2,280 steps at 1e-9 before; its first joints move within a tenth of a millisecond."""
    system, still = damped_beam(), np.zeros(10)
    motion = vi.simulate(system, q0=still, v0=still, duration=2.0, tol=tol)
    assert len(motion) < 400 and motion.stats["error_estimate"] <= tol
    last = vi.simulate(system, vi.gauss(8), q0=still, v0=still, h=2.0 / 3200, steps=3200)
    scale = np.abs(last.q).max()
    assert np.abs(motion.q[-1] - last.q[-1]).max() < tol * scale
    for k in (1, 2, 5, 12, 30, 60):
        h = motion.t[k] / 400
        early = vi.simulate(system, vi.gauss(8), q0=still, v0=still, h=h, steps=400)
        assert np.abs(motion.q[k] - early.q[-1]).max() < tol * scale


def test_a_beam_whose_velocities_have_no_formula_takes_few_steps_as_well(monkeypatch):
    """Of 28 elements: some 10,000 steps before, each by Newton's method; 3 s between nodes."""
    many, duration, tol = 28, 0.5, 1e-6
    system, still = damped_beam(many), np.zeros(many)
    motion = vi.simulate(system, q0=still, v0=still, duration=duration, tol=tol)
    assert len(motion) < 400 and motion.stats["error_estimate"] <= tol
    momentum = ca.gradient(system.lagrangian, system.v)
    push = ca.gradient(system.lagrangian, system.q) + system.force
    sides = ca.jacobian(momentum, system.v), push - ca.jtimes(momentum, system.q, system.v)
    motions = ca.Function("motions", [system.q, system.v], [ca.densify(x) for x in sides])

    def rates(_t, y):
        mass, side = call(motions, y[:many].copy(), y[many:].copy())
        return np.concatenate((y[many:], np.linalg.solve(mass.reshape(many, many), side)))

    times = np.array([0.0123, 0.2, duration])
    how = {"rtol": 1e-8, "atol": 1e-10, "t_eval": times}
    exact = solve_ivp(rates, (0, duration), np.zeros(2 * many), "Radau", **how).y[:many].T
    allowed = tol * np.abs(motion.q).max()
    assert np.abs(motion.q[-1] - exact[-1]).max() < allowed
    monkeypatch.setattr(dense_output, "steps_ahead", None)  # the loop that made it is at hand
    assert np.abs(motion.at(times).q - exact).max() < allowed


def test_an_arm_of_nine_joints_that_is_held_stiffly_takes_few_steps():
    q, v = vi.coordinates(*[f"a{i}" for i in range(9)])
    kinetic, height, vx, vy, y = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(9):
        part, mass = 0.25, 4.0 * 0.7**i
        vx, vy = vx - part * ca.sin(q[i]) * v[i], vy + part * ca.cos(q[i]) * v[i]
        y = y + part * ca.sin(q[i])
        kinetic += mass / 2 * (vx**2 + vy**2) + mass * 0.005 * v[i] ** 2
        height += mass * y
    goal, still = np.linspace(0.3, 0.9, 9), np.zeros(9)
    arm = vi.System(q, v, kinetic - 9.81 * height, force=-300 * (q - goal) - 20 * v)
    motion = vi.simulate(arm, q0=still, v0=still, duration=2.0)
    assert len(motion) < 300 and motion.stats["error_estimate"] <= 1e-9
    fine = vi.simulate(arm, vi.gauss(8), q0=still, v0=still, h=2.0 / 12000, steps=12000)
    assert np.abs(motion.q[-1] - fine.q[-1]).max() < 1e-9


def test_a_spring_that_is_met_late_is_resolved():
    """Steps have grown when a line that sinks in syrup meets a wall that bends sharply."""
    many = 7
    q, v = vi.coordinates(*[f"x{i}" for i in range(many)])
    wall = 0.02 * ca.sum1(ca.exp(40 * (q - 0.5)))
    energy = 50 * ca.sumsqr(q[1:] - q[:-1]) + wall - 3 * ca.sum1(q)
    system = vi.System(q, v, ca.sumsqr(v) / 2 - energy, force=-60 * v)
    still = np.zeros(many)
    for tol in (1e-4, 1e-8):
        motion = vi.simulate(system, q0=still, v0=still, duration=40.0, tol=tol)
        fine = vi.simulate(system, vi.gauss(8), q0=still, v0=still, h=40.0 / 4000, steps=4000)
        at = np.searchsorted(motion.t, 10.0)
        for k in (at, len(motion) - 1):
            there = fine.at([motion.t[k]]).q[0]
            assert np.abs(motion.q[k] - there).max() < tol


@pytest.mark.parametrize("tol", (1e-3, 1e-6, 1e-9))
def test_what_comes_to_rest_takes_few_steps(tol):
    """A million at 1e-9 before, half a minute."""
    system, still = resting_chain(), np.zeros(9)
    motion = vi.simulate(system, q0=still, v0=still, duration=20.0, tol=tol)
    assert len(motion) < 1500 and motion.stats["error_estimate"] <= tol
    late = np.flatnonzero(motion.t > 0.1)[0]
    for k in (1, 4, 9, 25, late, late + 30):
        h = motion.t[k] / 4000
        early = vi.simulate(system, vi.gauss(8), q0=still, v0=still, h=h, steps=4000)
        assert np.abs(motion.q[k] - early.q[-1]).max() < tol


@pytest.mark.parametrize("tol", (1e-4, 1e-9))
@pytest.mark.parametrize(
    "how", ({"progress": True}, {"backend": "compiled"}, {"backend": "native"})
)
def test_however_it_is_asked_for_the_steps_are_the_same(tol, how, capsys):
    """131,072 equal steps with a progress bar or a backend before, 144 that grow without."""
    q, v = vi.coordinates("x", "y")
    push = -5000.0 * ca.vertcat(v[0] - v[1], v[1] - v[0])
    energy = ca.sumsqr(q) / 2 + ca.sumsqr(q) ** 2 / 20
    system = vi.System(q, v, ca.sumsqr(v) / 2 - energy, force=push)
    asked = {"q0": [1.0, 0.2], "v0": [0.0, 0.0], "duration": 40.0, "tol": tol}
    plain, other = vi.simulate(system, **asked), vi.simulate(system, **asked, **how)
    assert len(plain) < 200 and plain.sizes is not None
    for name in ("t", "q", "p", "sizes"):
        assert getattr(plain, name).tobytes() == getattr(other, name).tobytes()
    assert plain.stats["runs"] == other.stats["runs"]
    capsys.readouterr()


def test_with_events_the_steps_are_the_same_and_the_times_those_of_equal_ones():
    """131,072 equal steps with events before."""
    q, v = vi.coordinates("x", "y")
    push = -500.0 * ca.vertcat(v[0] - v[1], v[1] - v[0])
    energy = ca.sumsqr(q) / 2 + ca.sumsqr(q) ** 2 / 20
    system = vi.System(q, v, ca.sumsqr(v) / 2 - energy, force=push)
    asked = {"q0": [1.0, 0.2], "v0": [0.0, 0.0], "duration": 20.0}
    watched = {"passes": q[0], "turns": v[0] + v[1]}
    plain, motion = vi.simulate(system, **asked), vi.simulate(system, **asked, events=watched)
    assert len(motion) < 200
    for name in ("t", "q", "p", "sizes"):
        assert getattr(plain, name).tobytes() == getattr(motion, name).tobytes()
    equal = vi.simulate(system, **asked, events=watched, steps=40_000)
    assert equal.sizes is None and len(equal.events) == len(motion.events) > 10
    for one, other in zip(motion.events, equal.events, strict=True):
        assert one.kind == other.kind and abs(one.time - other.time) < 1e-8
        assert np.abs(np.array(one.q) - other.q).max() < 1e-8


@pytest.fixture(scope="module")
def held_together():
    """Two masses that a damper of 500 holds together: the scene, its start and a fine motion."""
    q, v = vi.coordinates("x", "y")
    push = -500.0 * ca.vertcat(v[0] - v[1], v[1] - v[0])
    energy = ca.sumsqr(q) / 2 + ca.sumsqr(q) ** 2 / 20
    system = vi.System(q, v, ca.sumsqr(v) / 2 - energy, force=push)
    start = {"q0": [1.0, 0.2], "v0": [0.0, 0.0]}
    return system, start, vi.simulate(system, **start, duration=6.0, steps=12_000)


@pytest.mark.parametrize("tol", (1e-8, 1e-10))
def test_an_end_is_looked_for_along_the_motion_of_the_whole_duration(tol, held_together, tmp_path):
    """7,000 equal steps and 100 ms before."""
    system, start, fine = held_together
    x = system.q[0]
    whole = vi.simulate(system, **start, duration=20.0, tol=tol)
    ended = vi.simulate(system, **start, duration=20.0, tol=tol, until=x + 0.1)
    many = len(ended) - 1
    assert ended.sizes is not None and 1 < many < len(whole) < 200
    for name in ("t", "q", "p"):
        assert np.array_equal(getattr(ended, name)[:many], getattr(whole, name)[:many])
    equal = vi.simulate(system, **start, duration=20.0, steps=40_000, until=x + 0.1)
    assert abs(ended.t[-1] - equal.t[-1]) < 2 * tol
    assert np.abs(ended.q[-1] - equal.q[-1]).max() < 2 * tol
    ended.save(tmp_path / "ended.npz")
    kept = vi.load(tmp_path / "ended.npz")
    middle = ended.t[-1] / 2
    assert np.array_equal(kept.q, ended.q) and kept.t[-1] == ended.t[-1]
    assert np.array_equal(kept.at([middle]).q, ended.at([middle]).q)
    assert np.abs(ended.at([middle]).q - fine.at([middle]).q).max() < 2 * tol
    never = vi.simulate(system, **start, duration=20.0, tol=tol, until=x + 3)
    assert np.array_equal(never.q, whole.q)


@pytest.mark.parametrize("depth", (1e-3, 1e-6))
def test_an_end_that_is_hardly_reached_is_as_exact_as_any(depth, held_together):
    """Where the expression hardly changes an error of its zero is that of its time many times."""
    system, start, fine = held_together
    place = fine.q[:, 0].min() + depth
    end = vi.simulate(system, **start, duration=6.0, steps=12_000, until=system.q[0] - place)
    speed = abs(end.v[-1, 0])
    for tol in (1e-5, 1e-7):
        motion = vi.simulate(system, **start, duration=6.0, tol=tol, until=system.q[0] - place)
        assert motion.stats["error_estimate"] <= tol
        moved = max(abs(motion.t[-1] - end.t[-1]) * speed, np.abs(motion.q[-1] - end.q[-1]).max())
        assert moved < tol * 2


@pytest.mark.parametrize("ends", ((), ("events",), ("until",), ("events", "until")))
def test_every_so_many_nodes_of_steps_that_grow_are_kept(ends, held_together):
    """Some thousand equal steps before; what lies between nodes is that of all of them."""
    system, start, _ = held_together
    asked = start | {"duration": 20.0, "tol": 1e-10}
    if "events" in ends:
        asked["events"] = {"passes": system.q[0]}
    if "until" in ends:
        asked["until"] = system.q[0] + 0.1
    whole, some = vi.simulate(system, **asked), vi.simulate(system, **asked, save_every=5)
    kept = np.append(np.arange(0, len(whole) - 1, 5), len(whole) - 1)
    assert whole.sizes is not None and len(whole) < 200
    for name in ("t", "q", "p"):
        assert np.array_equal(getattr(some, name), getattr(whole, name)[kept])
    assert some.events == whole.events and bool(some.events) == ("events" in ends)
    assert all(event.time <= whole.t[-1] for event in whole.events)
    times = np.linspace(0, whole.t[-1], 33)
    assert np.array_equal(some.at(times).q, whole.at(times).q)
    assert (
        vi.simulate(system, **asked, save_every=5, progress=False).q.tobytes() == some.q.tobytes()
    )


def arm(joints: int, damping: float, stiffness: float) -> vi.System:
    """An arm whose links become lighter from joint to joint, each with a spring and a damper."""
    axes, world, last = ((0, 1, 0), (1, 0, 0), (0, 0, 1)), mb.Model(), "world"
    for i in range(joints):
        mass = 2 * 0.7**i
        inertia = (0.02 * mass, 0.025 * mass, 0.01 * mass)
        link = world.body(mass, (0.02, 0.01, -0.2), inertia, f"link{i}")
        passive = mb.Passive(damping=damping, stiffness=stiffness)
        world.revolute(last, link, axes[i % 3], (0, 0, -0.4 if i else 0), passive=passive)
        last = link
    return world.system()


@pytest.mark.parametrize("tol", (1e-4, 1e-9))
def test_a_machine_whose_joints_are_damped_takes_few_steps(tol, tmp_path, capsys):
    """26,000 steps and more before, a second."""
    system, duration = arm(6, 50.0, 100.0), 3.0
    start = {"q0": np.linspace(0.3, 0.8, 6), "v0": np.zeros(6)}
    motion = vi.simulate(system, **start, duration=duration, tol=tol)
    assert motion.system is system and len(motion) < 200
    assert motion.stats["error_estimate"] <= tol
    fine = vi.simulate(system, vi.gauss(8), **start, h=duration / 20_000, steps=20_000)
    times = np.linspace(0, duration, 21)
    assert np.abs(motion.at(times).q - fine.at(times).q).max() < tol
    assert np.abs(motion.q - fine.at(motion.t).q).max() < tol
    assert states_by_core(motion, times) is not None  # interpreted before
    shown = vi.simulate(system, **start, duration=duration, tol=tol, progress=True)
    assert shown.q.tobytes() == motion.q.tobytes()
    capsys.readouterr()
    motion.save(tmp_path / "arm.npz")
    assert np.array_equal(vi.load(tmp_path / "arm.npz").at(times).q, motion.at(times).q)


def test_a_machine_that_is_hardly_damped_is_run_by_what_it_tells_of_itself():
    for damping, without in ((1e-4, False), (50.0, True)):
        system, q0 = arm(6, damping, 0.0), np.linspace(0.3, 0.8, 6)
        turned = damped_turns(system, q0, np.zeros(6), 0.0, system.default_vector, 3.0)
        assert has_slopes_without(system, turned[1]) == without
    plain = line(100.0, 300.0, bent=1.0)
    assert not has_slopes_without(plain, 1e8)


DRIVES = {
    "from the start": lambda t: 3 * ca.sin(2 * t),
    "a late pulse": lambda t: 20 * ca.exp(-(((t - 3.3) / 0.02) ** 2)),
    "a late switch": lambda t: 5 * (1 + ca.tanh((t - 2.2) / 0.05)),
}


@pytest.mark.parametrize("tol", (1e-4, 1e-9))
@pytest.mark.parametrize("drive", DRIVES)
def test_driven_scenes_with_stiff_dampers_take_few_steps(drive, tol):
    """By sin(2 t) 7,168 equal steps at 1e-9 before; what begins late is met by long steps."""
    (q, v), t = vi.coordinates("x", "y"), vi.time()
    push = -5000.0 * ca.vertcat(v[0] - v[1], v[1] - v[0]) + ca.vertcat(DRIVES[drive](t), 0)
    energy = 20 * q[0] ** 2 + 5 * q[1] ** 4
    system = vi.System(q, v, ca.sumsqr(v) / 2 - energy, force=push, t=t)
    asked = {"q0": [1.0, 0.5], "v0": [0.0, 0.0], "duration": 5.0, "tol": tol}
    motion = vi.simulate(system, **asked, t0=-1.0)
    if drive == "from the start":
        assert len(motion) < 150 and motion.sizes is not None
    slopes = ca.gradient(system.lagrangian, q) + system.force
    pushed = ca.Function(
        "pushed", [q, v, t], [slopes, ca.densify(ca.jacobian(slopes, ca.vertcat(q, v)))]
    )

    def rates(time, y):
        return np.concatenate(
            (y[2:], call(pushed, y[:2].copy(), y[2:].copy(), np.array([time]))[0])
        )

    def jacobian(time, y):
        found = call(pushed, y[:2].copy(), y[2:].copy(), np.array([time]))[1]
        return np.vstack((np.eye(2, 4, 2), found.reshape(4, 2).T))

    how = {"rtol": 1e-10, "atol": 1e-12, "jac": jacobian, "max_step": 0.01}
    exact = solve_ivp(rates, (-1.0, 4.0), [1.0, 0.5, 0.0, 0.0], "Radau", t_eval=motion.t, **how)
    assert np.abs(motion.q - exact.y[:2].T).max() < tol + 1e-9


def test_an_end_at_once_is_told():
    """A speed that is zero at the start, and soon again: a bare ValueError before."""
    system = arm(6, 50.0, 100.0)
    asked = {"q0": np.linspace(0.3, 0.8, 6), "v0": np.zeros(6), "duration": 3.0}
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        motion = vi.simulate(system, **asked, until=system.v[0])
    small = motion.stats["error_estimate"] <= 1e-9
    assert small or "out of reach" in str(told[-1].message)
    assert 0 < motion.t[-1] < 3 and abs(motion.v[-1, 0]) < 1e-7


def row(masses, damper):
    """Masses in a row, each held together with the next by a spring and a damper."""
    q, v = vi.coordinates(*(f"x{i}" for i in range(masses)))
    apart, rates = q[1:] - q[:-1], v[1:] - v[:-1]
    energy = 5 * ca.sumsqr(apart) + ca.sum1(apart**4) / 4 + ca.sumsqr(q) / 20
    force = damper * (ca.vertcat(rates, 0) - ca.vertcat(0, rates))
    return vi.System(q, v, ca.sumsqr(v) / 2 - energy, force=force)


@pytest.mark.parametrize("masses", (61, 80))
def test_stiff_dampers_between_many_masses_take_few_steps(masses):
    """Beyond sixty coordinates 16,000 equal steps and more before."""
    start = {"q0": np.sin(0.3 * np.arange(masses)), "v0": np.zeros(masses), "duration": 10.0}
    motion = vi.simulate(row(masses, 500.0), **start)
    assert len(motion) < 200 and motion.stats["error_estimate"] <= 1e-9
    fine = vi.simulate(row(masses, 500.0), tol=1e-12, **start)
    scale = np.abs(fine.q).max()
    assert np.abs(motion.q - fine.at(motion.t).q).max() < 2e-9 * scale
    weak = vi.simulate(row(masses, 0.01), **start)  # looked at, and not stiff
    assert np.ptp(np.diff(weak.t)) < 1e-12


def test_stiff_dampers_of_more_than_sixty_links_are_looked_at():
    """An elastic beam with dampers in its joints: 65,536 equal steps before, in minutes."""
    links, duration = 64, 0.5
    q, v = vi.coordinates(*(f"a{i}" for i in range(links)))
    bends, turns = q - ca.vertcat(0, q[:-1]), v - ca.vertcat(0, v[:-1])
    across = ca.cumsum(ca.cos(q) * v) / links
    along = ca.cumsum(ca.sin(q) * v) / links
    moving = (ca.sumsqr(across) + ca.sumsqr(along)) / (2 * links) + ca.sumsqr(v) / (24 * links**3)
    falling = 9.81 * ca.sum1(ca.cumsum(ca.sin(q))) / links**2
    force = -6.4 * (turns - ca.vertcat(turns[1:], 0))
    beam = vi.System(q, v, moving - falling - 10 * links * ca.sumsqr(bends), force=force)
    start = {"q0": np.zeros(links), "v0": np.zeros(links), "duration": duration}
    motion = vi.simulate(beam, **start)
    assert len(motion) < 3000 and motion.stats["error_estimate"] <= 1e-9
    coarse = vi.simulate(beam, tol=1e-7, **start)
    assert np.abs(motion.q[-1] - coarse.q[-1]).max() < 2e-6 * np.abs(motion.q).max()
