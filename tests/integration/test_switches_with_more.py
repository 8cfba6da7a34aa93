"""Forces that jump or kink in scenes with constraints and controls: steps end at the switches
there, too, and what dry friction stops is held.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from machines import plane_chain
from scipy.integrate import solve_ivp

import varint as vi
from varint.integration.switches import runs
from varint.integration.switches.frozen import frozen_scene
from varint.multibody.kinematics import body_rates
from varint.multibody.rotations import quaternion_rate

TOL = 1e-9
GRAVITY, RUB = 9.81, 0.3


def angle_pendulum(mu):
    """θ from the downward vertical, m = l = 1, dry friction of torque μ at the pivot."""
    q, v = vi.coordinates("theta")
    return vi.System(q, v, v**2 / 2 + GRAVITY * ca.cos(q), force=-mu * ca.sign(v))


def cartesian_pendulum(mu):
    q, v = vi.coordinates("x", "y")
    turning = q[0] * v[1] - q[1] * v[0]
    return vi.System(
        q,
        v,
        ca.sumsqr(v) / 2 - GRAVITY * q[1],
        force=-mu * ca.sign(turning) * ca.vertcat(-q[1], q[0]),
        constraint=ca.sumsqr(q) - 1,
    )


def test_a_cartesian_pendulum_with_a_dry_pivot_moves_as_the_one_in_its_angle_does():
    """Four swings, then it is held where friction can: |g sin θ| ≤ μ."""
    one = vi.simulate(angle_pendulum(4.0), q0=1.5, v0=0.0, duration=5.0, tol=1e-12)
    start = [np.sin(1.5), -np.cos(1.5)]
    motion = vi.simulate(cartesian_pendulum(4.0), q0=start, v0=[0.0, 0.0], duration=5.0)
    theta = one.at(motion.t).q[:, 0]
    exact = np.stack([np.sin(theta), -np.cos(theta)], axis=1)
    assert np.abs(motion.q - exact).max() < TOL / 10
    assert motion.stats["error_estimate"] < TOL
    assert motion.stats["switches"] == one.stats["switches"] >= 2
    assert np.abs(motion.v[-1]).max() < 1e-13
    assert abs(np.sin(theta[-1])) * GRAVITY < 4.0
    times = np.linspace(0, 5, 57)
    off = motion.at(times).q[:, 0] - np.sin(one.at(times).q[:, 0])
    assert np.abs(off).max() < TOL / 10


@pytest.mark.long
def test_four_bars_with_a_dry_crank_keep_the_balance_of_energy_and_stop():
    """ΔH = −μ times all that the crank turns, for a parallel crank drive, which closes as one
    angle: (a, b, c) with b = 0, c = a.
    """
    q, v = vi.coordinates("a", "b", "c")
    mu, length, inertia = 0.9, 2.0, (1.0, 0.7, 0.5)
    loop = ca.vertcat(
        ca.cos(q[0]) + length * ca.cos(q[1]) - ca.cos(q[2]) - length,
        ca.sin(q[0]) + length * ca.sin(q[1]) - ca.sin(q[2]),
    )
    kinetic = sum(inertia[i] * v[i] ** 2 for i in range(3)) / 2
    scene = vi.System(
        q,
        v,
        kinetic - GRAVITY * ca.sin(q[0]),
        force=ca.vertcat(-mu * ca.sign(v[0]), 0, 0),
        constraint=loop,
    )
    # b = 0 all the time: (inertia of a and c) a'' = −g cos a − μ sign a'
    a, w = vi.coordinates("a")
    one = vi.System(
        a,
        w,
        (inertia[0] + inertia[2]) * w**2 / 2 - GRAVITY * ca.sin(a),
        force=-mu * ca.sign(w),
    )
    start = -np.pi / 2 + 0.8
    known = vi.simulate(one, q0=start, v0=0.0, duration=6.0, tol=1e-12)
    motion = vi.simulate(scene, q0=[start, 0.0, start], v0=[0.0, 0.0, 0.0], duration=6.0)
    exact = known.at(motion.t).q
    assert np.abs(motion.q - exact * [1, 0, 1]).max() < TOL / 10
    assert motion.stats["switches"] == known.stats["switches"] >= 2
    turned = np.abs(np.diff(motion.q[:, 0])).sum()
    assert motion.energy[-1] - motion.energy[0] == pytest.approx(-mu * turned, abs=1e-9)


def pushed_oscillator():
    q, v = vi.coordinates("x")
    u = ca.SX.sym("u")
    return vi.System(q, v, v**2 / 2 - q**2 / 2, force=u - RUB * ca.sign(v), control=u)


def half_circles(x, v, rows, size):
    """Ends of x'' = −x + u − μ sign v over rows of one control each: circles about u ∓ μ, held
    where |u − x| ≤ μ; by their angles.
    """
    ends = [x]
    for u in rows:
        left = size
        while left > 0:
            way = np.sign(v) if v else np.sign(u - x) * (abs(u - x) > RUB)
            if way == 0:
                break
            centre = u - RUB * way
            phase = np.arctan2(way * v, -way * (x - centre))  # from rest at the far end
            radius = np.hypot(x - centre, v)
            span = min(left, np.pi - phase)
            x = centre - way * radius * np.cos(phase + span)
            v = 0.0 if span < left else way * radius * np.sin(phase + span)
            left -= span
        ends.append(x)
    return np.array(ends)


def test_a_table_of_controls_and_dry_friction_move_on_half_circles():
    rows = 1.5 * np.sin(1.3 * np.arange(24.0))
    motion = vi.simulate(pushed_oscillator(), q0=1.0, v0=0.0, duration=24 * 0.7, u=rows[:, None])
    exact = half_circles(1.0, 0.0, rows, 0.7)
    assert np.abs(motion.at(0.7 * np.arange(25)).q[:, 0] - exact).max() < 1e-12
    assert motion.stats["error_estimate"] < TOL
    row = np.minimum((motion.t / 0.7 + 1e-9).astype(int), 23)
    assert (motion.u[:, 0, 0] == rows[row[:-1]]).all()


def test_one_control_all_the_time_moves_on_half_circles_until_friction_holds():
    motion = vi.simulate(pushed_oscillator(), q0=2.0, v0=0.0, duration=12.0, u=[0.2])
    exact = half_circles(2.0, 0.0, np.full(40, 0.2), 0.3)
    assert np.abs(motion.at(0.3 * np.arange(41)).q[:, 0] - exact).max() < 1e-12
    assert abs(motion.v[-1, 0]) < 1e-15


def test_a_motion_with_switches_and_controls_comes_back_from_its_file(tmp_path):
    motion = vi.simulate(
        pushed_oscillator(), q0=2.0, v0=0.0, duration=6.0, u=[[0.2], [-0.4], [0.1]]
    )
    motion.save(tmp_path / "motion.npz")
    again, times = vi.load(tmp_path / "motion.npz"), np.linspace(0, 6, 23)
    assert (again.at(times).q == motion.at(times).q).all()
    assert (again.u == motion.u).all()


def test_what_switches_by_a_control_settles_where_its_row_begins():
    """x'' = sign(u − t): the sign turns where t passes u, or u passes t."""
    q, v, t = *vi.coordinates("x"), vi.time()
    u = ca.SX.sym("u")
    scene = vi.System(q, v, v**2 / 2, force=ca.sign(u - t), control=u, t=t)
    motion = vi.simulate(scene, q0=0.0, v0=0.0, duration=4.0, u=[[0.5], [3.5]])
    # + until 0.5, − until 2, + until 3.5, −
    assert motion.v[-1, 0] == pytest.approx(0.5 - 1.5 + 1.5 - 0.5, abs=1e-14)
    assert motion.q[-1, 0] == pytest.approx(0.125 - 0.375 - 0.375 + 0.125, abs=1e-13)


def dry_body(by_rays):
    """Moments of inertia 1, 2, 3, and a torque of dry friction about the third axis."""
    q, v = vi.coordinates("w", "x", "y", "z")
    square = ca.sumsqr(q)
    rates = body_rates(q, v)
    kinetic = ca.dot(ca.DM([1.0, 2.0, 3.0]), rates**2) / 2
    force = ca.jacobian(rates, v).T @ ca.vertcat(0, 0, -0.5 * ca.sign(rates[2]))
    if by_rays:
        length = (ca.dot(q, v) / square) ** 2 / 2
        return vi.System(q, v, kinetic + length, force=force, rays=[range(4)])
    return vi.System(q, v, kinetic, force=force, constraint=square - 1)


def euler_s_equations(rates, times):
    """I ω' + ω × I ω = τ until ω₃ is zero, then with ω₃ held; attitudes by q' = ½ q ∘ (0, ω)."""
    inertia = np.array([1.0, 2.0, 3.0])

    def slope(_t, x, dry):
        w, q = x[:3], x[3:]
        a = -np.cross(w, inertia * w) / inertia
        a[2] = a[2] - 0.5 / 3 if dry else 0.0
        turn = np.concatenate([[-q[1:] @ w], q[0] * w + np.cross(q[1:], w)]) / 2
        return np.concatenate([a, turn])

    def stops(_t, x, _dry):
        return x[2]

    stops.terminal = True
    begin = np.concatenate([rates, [1.0, 0.0, 0.0, 0.0]])
    options = dict(method="DOP853", rtol=1e-12, atol=1e-13, dense_output=True)
    first = solve_ivp(slope, (0, times[-1]), begin, events=stops, args=(True,), **options)
    at_rest = first.y[:, -1] * [1, 1, 0, 1, 1, 1, 1]
    then = solve_ivp(slope, (first.t[-1], times[-1]), at_rest, args=(False,), **options)
    return np.where(times < first.t[-1], first.sol(times), then.sol(times))[3:].T


@pytest.mark.parametrize("by_rays", [True, pytest.param(False, marks=pytest.mark.long)])
def test_a_body_by_a_quaternion_comes_to_rest_about_its_dry_axis(by_rays):
    rates, times = np.array([0.3, 0.2, 1.0]), np.linspace(0.0, 10.0, 41)
    q0 = np.array([1.0, 0.0, 0.0, 0.0])
    scene = dry_body(by_rays)
    motion = vi.simulate(scene, q0=q0, v0=quaternion_rate(q0, rates), duration=10.0)
    exact = euler_s_equations(rates, times)
    assert motion.stats["switches"] == 1
    assert np.abs(motion.at(times).q - exact).max() < 3e-11
    assert np.abs(np.linalg.norm(motion.q, axis=1) - 1).max() < 1e-14


def hinges(count, mu, relative):
    """Links of unit length with unit masses at their ends; dry friction in every hinge. In angles
    to the vertical, or each to the link before.
    """
    q, v = vi.coordinates(*(f"a{i}" for i in range(count)))
    angles = [sum(q[k] for k in range(i + 1)) if relative else q[i] for i in range(count)]
    rates = [sum(v[k] for k in range(i + 1)) if relative else v[i] for i in range(count)]
    lagrangian, height, speed = 0, 0, ca.SX.zeros(2)
    for angle, rate in zip(angles, rates, strict=True):
        height = height - ca.cos(angle)
        speed = speed + rate * ca.vertcat(ca.cos(angle), ca.sin(angle))
        lagrangian = lagrangian + ca.sumsqr(speed) / 2 - GRAVITY * height
    turning = v if relative else v - ca.vertcat(0, v[:-1])
    force = ca.jtimes(turning, v, -mu * ca.sign(turning), True)
    return vi.System(q, v, lagrangian, force=force)


def test_hinges_that_stick_and_slip_move_alike_in_both_kinds_of_angles():
    """Which of three hold is a complementarity problem; what they rub away is their energy."""
    mu, start = 1.5, np.array([1.2, 0.9, 1.4])
    two = [
        vi.simulate(
            hinges(3, mu, relative),
            q0=np.diff(start, prepend=0.0) if relative else start,
            v0=np.zeros(3),
            duration=2.5,
        )
        for relative in (False, True)
    ]
    times = np.linspace(0, 2.5, 26)
    angles, turned = (motion.at(times).q for motion in two)
    assert np.abs(np.cumsum(turned, axis=1) - angles).max() < 1e-11
    assert two[0].stats["switches"] == two[1].stats["switches"] >= 6
    held = np.abs(two[1].v) < 1e-13
    assert (held.sum(axis=1) == 1).any()
    assert (held.sum(axis=1) == 2).any()
    rubbed = mu * np.abs(np.diff(two[1].q, axis=0)).sum(axis=0).sum()
    assert two[1].energy[-1] - two[1].energy[0] == pytest.approx(-rubbed, abs=1e-10)


def test_a_blade_that_turns_against_dry_friction_follows_its_heading():
    """θ = t − μ t²/2 until it rests; the path is ∫ (cos θ, sin θ) dt, then a straight line."""
    q, v = vi.coordinates("x", "y", "heading")
    scene = vi.System(
        q,
        v,
        ca.sumsqr(v) / 2,
        force=ca.vertcat(0, 0, -RUB * ca.sign(v[2])),
        nonholonomic=ca.horzcat(ca.sin(q[2]), -ca.cos(q[2]), 0),
    )
    motion = vi.simulate(scene, q0=[0, 0, 0], v0=[1.0, 0, 1.0], duration=5.0, tol=1e-7)
    turning = np.minimum(motion.t, 1 / RUB)
    heading = turning - RUB * turning**2 / 2
    assert np.abs(motion.q[:, 2] - heading).max() < 1e-14
    x, w = np.polynomial.legendre.leggauss(40)
    way = np.array([np.cos, np.sin])
    s = (x + 1) / 2 / RUB
    curve = [f(s - RUB * s**2 / 2) @ w / 2 / RUB for f in way]
    rest = 5.0 - 1 / RUB
    exact = [a + rest * f(heading[-1]) for a, f in zip(curve, way, strict=True)]
    off = np.abs(motion.q[-1, :2] - exact).max()
    assert off < motion.stats["error_estimate"] * np.ptp(motion.q, axis=0).max() < 2e-7


def test_a_checkpoint_holds_a_run_with_switches_once_it_has_ended(tmp_path, monkeypatch):
    scene, path = angle_pendulum(RUB), tmp_path / "run.npz"
    call = dict(q0=1.5, v0=0.0, duration=8.0, events={"down": scene.q})
    whole = vi.simulate(scene, **call)
    first = vi.simulate(scene, **call, checkpoint=path)
    monkeypatch.setattr(runs, "follow", None)  # no step is taken any more
    again = vi.simulate(scene, **call, checkpoint=path)
    for name in ("t", "q", "p", "v", "sizes"):
        assert (getattr(first, name) == getattr(whole, name)).all()
        assert (getattr(again, name) == getattr(whole, name)).all()
    assert again.events == whole.events
    assert again.stats["error_estimate"] == whole.stats["error_estimate"]
    times = np.linspace(0, 8, 11)
    assert (again.at(times).q == whole.at(times).q).all()
    with pytest.raises(vi.InputError, match="belongs to another run"):
        vi.simulate(scene, **call | {"q0": 1.4}, checkpoint=path)
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(vi.InputError, match="torn"):
        vi.simulate(scene, **call, checkpoint=path)


@pytest.mark.long
def test_a_machine_with_dry_hinges_moves_as_the_scene_written_by_hand():
    """Machines bring their mass matrix and v(p) along (`System.kinetics`)."""
    machine = plane_chain(2).system()
    force = machine.force - 1.5 * ca.sign(machine.v)
    scene = vi.System(
        machine.q,
        machine.v,
        machine.lagrangian,
        force=force,
        params=machine.params,
        kinetics=machine.kinetics,
    )
    assert scene.kinetics is not None
    by_hand = hinges(2, 1.5, relative=True)
    one, other = (
        vi.simulate(x, q0=[1.0, 0.5], v0=[0.0, 0.0], duration=3.0) for x in (scene, by_hand)
    )
    assert one.stats["switches"] == other.stats["switches"] >= 5
    assert np.abs(one.at(other.t).q - other.q).max() < 1e-11


def block_held_by_friction():
    q, v = vi.coordinates("x")
    scene = vi.System(q, v, v**2 / 2 - 2 * (q - 1) ** 2, force=-ca.sign(v))
    return scene, {"q0": 1.1, "v0": 0.0}


def bead_with_a_dry_pivot_from_rest():
    q, v = vi.coordinates("x", "y")
    force = ca.vertcat(-ca.sign(v[0]), 0)
    lagrangian, wire = ca.sumsqr(v) / 2 - 9.81 * q[1], ca.sumsqr(q) - 1
    scene = vi.System(q, v, lagrangian, force=force, constraint=wire)
    return scene, {"q0": [0.6, -0.8], "v0": [0.0, 0.0]}


def bead_pushed_harder_later():
    q, v = vi.coordinates("x", "y")
    t = vi.time()
    force = ca.vertcat(ca.if_else(t < 0.5, 1, 3), 0)
    lagrangian, wire = ca.sumsqr(v) / 2 - 9.81 * q[1], ca.sumsqr(q) - 1
    scene = vi.System(q, v, lagrangian, force=force, constraint=wire, t=t)
    return scene, {"q0": [0.6, -0.8], "v0": [0.0, 0.0]}


@pytest.mark.parametrize(
    "build", [block_held_by_friction, bead_with_a_dry_pivot_from_rest, bead_pushed_harder_later]
)
def test_derivatives_where_the_written_scene_is_another_one_are_refused(build):
    """Shares of friction that holds, and sides at nodes on a switch, are not in what is written."""
    scene, start = build()
    motion = vi.simulate(scene, **start, duration=1.0)
    assert motion.stats["error_estimate"] < 1e-9
    with pytest.raises(vi.InputError, match="as it is written is another one"):
        motion.transition_matrix()
    with pytest.raises(vi.InputError, match="as it is written is another one"):
        vi.gradient(motion, terminal_loss=scene.q[0])


def rocket(after):
    """It burns one of its ten units of mass a unit of time, for five of them."""
    (q, v), t = vi.coordinates("z"), vi.time()
    burns = t < 5
    mass = ca.if_else(burns, 10 - t, after)
    push = ca.if_else(burns, 200 - v, 0)  # d(m v)/dt = m dv/dt + v dm/dt
    return vi.System(q, v, mass * (v**2 / 2 - 9.81 * q), force=push, t=t)


def test_a_rocket_ends_a_step_where_it_has_burnt_out():
    """z of Tsiolkovsky's equation, and free flight behind it; a mass that drops keeps momentum."""
    burnt = 200 * (5 * np.log(0.5) + 5) - 9.81 * 12.5, 200 * np.log(2) - 9.81 * 5
    for after in (5.0, 2.0):
        motion = vi.simulate(rocket(after), q0=0.0, v0=0.0, duration=12.0)
        end = burnt[0] + burnt[1] * (5 / after) * 7 - 9.81 * 24.5
        assert motion.q[-1, 0] == pytest.approx(end, rel=1e-10)
        assert 5.0 in motion.t and motion.stats["steps"] < 100
        assert motion.stats["error_estimate"] < 1e-9
    high = vi.simulate(rocket(5.0), q0=0.0, v0=0.0, duration=60.0, until=rocket(5.0).q - 400)
    assert high.q[-1, 0] == pytest.approx(400, abs=1e-7) and high.t[-1] > 5


def test_a_pendulum_that_is_let_out_for_a_while_ends_steps_where_its_rope_begins_and_ends_to_run():
    (q, v), t = vi.coordinates("theta"), vi.time()
    length = 1 + ca.fmin(ca.fmax(t - 2, 0), 2) / 4
    lagrangian = length**2 * v**2 / 2 + 9.81 * length * ca.cos(q)
    motion = vi.simulate(vi.System(q, v, lagrangian, t=t), q0=0.5, v0=0.0, duration=8.0)
    assert {2.0, 4.0} <= set(motion.t.tolist()) and motion.stats["steps"] < 200

    def rate(time, y):
        long, runs = 1 + min(max(time - 2, 0), 2) / 4, 0.25 * (2 < time < 4)
        return [y[1], (-9.81 * np.sin(y[0]) - 2 * runs * y[1]) / long]

    state = np.array([0.5, 0.0])
    for begin, end in ((0, 2), (2, 4), (4, 8)):
        inside = (begin + 1e-15, end - 1e-15)
        found = solve_ivp(rate, inside, state, method="DOP853", rtol=1e-13, atol=1e-14)
        state = found.y[:, -1]
    assert motion.q[-1, 0] == pytest.approx(state[0], abs=1e-10)


def test_inertia_that_switches_by_the_motion_is_not_cut_there():
    """Its momenta would jump."""
    q, v = vi.coordinates("x")
    system = vi.System(q, v, ca.if_else(q > 1, 2.0, 1.0) * v**2 / 2 - q**2 / 2)
    assert frozen_scene(system) is None
