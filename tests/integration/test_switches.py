"""Forces and potentials that jump or kink: steps end where the scene switches, so that closed forms
are met to the tolerance in few steps, and estimates are honest.
"""

from __future__ import annotations

import pickle

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import varint as vi
from varint.integration.error_scale import error_scales
from varint.integration.switches.joined import between_nodes

TOL, ROUND_OFF = 1e-9, 1e-13


def scene(lagrangian, force=None):
    """One coordinate: L(q, v, t) and F(q, v, t)."""
    q, v, t = *vi.coordinates("x"), vi.time()
    pushed = None if force is None else force(q, v, t)
    return vi.System(q, v, lagrangian(q, v, t), force=pushed, t=t)


def oscillator(q, v, _t):
    return v**2 / 2 - q**2 / 2


def assert_met(motion, exact, *, switches=None, most=None):
    """Every node is within tol of the closed form, as the estimate says; in few steps."""
    off = np.abs(motion.q[:, 0] - exact(motion.t)) / error_scales(motion.system, motion)
    assert off.max() <= max(motion.stats["error_estimate"], ROUND_OFF) <= TOL
    assert switches is None or motion.stats["switches"] == switches
    assert most is None or motion.stats["steps"] <= most


def parabolas(start):
    """x'' = −sign x from rest at `start`: arcs of a quarter period √(2 start)."""
    quarter = (2 * start) ** 0.5

    def exact(t):
        s = np.mod(t, 4 * quarter)
        middle = start - (s - 4 * quarter) ** 2 / 2
        middle = np.where(s < 3 * quarter, (s - 2 * quarter) ** 2 / 2 - start, middle)
        return np.where(s < quarter, start - s**2 / 2, middle)

    return exact


@pytest.mark.parametrize(("start", "duration"), [(1.0, 40.0), (0.125, 180.0)])
def test_a_ball_in_the_potential_of_a_kink_moves_on_parabolas(start, duration):
    motion = vi.simulate(
        scene(lambda q, v, _t: v**2 / 2 - ca.fabs(q)), q0=start, v0=0.0, duration=duration
    )
    period = 4 * (2 * start) ** 0.5
    crossings = int(np.floor((duration - period / 4) / (period / 2))) + 1
    assert_met(motion, parabolas(start), switches=crossings, most=20 * crossings)
    energy = motion.energy
    assert np.abs(energy - energy[0]).max() < 1e-13


def test_one_sided_springs_take_half_a_period_of_each():
    w = 10.0, 2.0
    motion = vi.simulate(
        scene(
            lambda q, v, _t: (v**2 - (w[0] * ca.fmax(0, q)) ** 2 - (w[1] * ca.fmin(0, q)) ** 2) / 2
        ),
        q0=0.0,
        v0=1.0,
        duration=20.0,
    )

    def exact(t):
        half = np.pi / w[0], np.pi / w[1]
        s = np.mod(t, half[0] + half[1])
        late = s - half[0]
        return np.where(late < 0, np.sin(w[0] * s) / w[0], -np.sin(w[1] * late) / w[1])

    assert_met(motion, exact, most=250)


def coulomb(mu, start):
    """x'' = −x − μ sign v from rest: half circles about ±μ until |x| ≤ μ."""
    turns = [start]
    while abs(turns[-1]) > mu:
        turns.append(2 * mu * np.sign(turns[-1]) - turns[-1])

    def exact(t):
        half = np.minimum((t // np.pi).astype(int), len(turns) - 1)
        turn = np.array(turns)[half]
        centre = mu * np.sign(turn)
        moving = centre + (turn - centre) * np.cos(t - half * np.pi)
        return np.where(half == len(turns) - 1, turn, moving)

    return exact, len(turns) - 1


@pytest.mark.parametrize("mu", [0.15, 0.03])
def test_dry_friction_takes_twice_its_reach_every_half_swing_and_holds_at_the_end(mu):
    motion = vi.simulate(
        scene(oscillator, lambda q, v, _t: -mu * ca.sign(v)), q0=1.0, v0=0.0, duration=60.0
    )
    exact, swings = coulomb(mu, 1.0)
    assert_met(motion, exact, switches=swings, most=20 * swings + 100)
    held = motion.t > swings * np.pi + 0.1
    assert held.any() and np.abs(motion.v[held]).max() < 1e-14


def test_a_mass_on_a_belt_sticks_and_slips_by_its_closed_form():
    """Carried at the belt's speed to where the spring pulls as hard as friction holds; it then
    slides on a circle about μ, and just comes back to the belt's speed after a whole turn.
    """
    mu, speed = 0.5, 0.3
    motion = vi.simulate(
        scene(oscillator, lambda q, v, _t: -mu * ca.sign(v - speed)), q0=0.0, v0=0.0, duration=7.5
    )
    # from rest about μ, until it is as fast as the belt
    first = np.arcsin(speed / mu)
    place = mu - mu * np.cos(first)
    slips = first + (mu - place) / speed

    def exact(t):
        carried = np.where(t < slips, place + speed * (t - first), mu + speed * np.sin(t - slips))
        return np.where(t < first, mu - mu * np.cos(t), carried)

    assert_met(motion, exact)
    stuck = (motion.t > first + 0.1) & (motion.t < slips)
    assert stuck.any() and np.abs(motion.v[stuck] - speed).max() < 1e-13


def test_a_block_under_a_growing_force_slips_when_friction_gives_way():
    """x'' = t/4 − sign v from rest: held until t = 4."""
    motion = vi.simulate(
        scene(lambda q, v, _t: v**2 / 2, lambda q, v, t: t / 4 - ca.sign(v)),
        q0=0.7,
        v0=0.0,
        duration=10.0,
    )
    assert_met(motion, lambda t: 0.7 + np.maximum(t - 4, 0) ** 3 / 24, switches=1, most=60)


@pytest.mark.parametrize("at", [1.0, np.pi / 3])
def test_a_force_that_is_switched_on_is_met_at_its_very_time(at):
    motion = vi.simulate(
        scene(oscillator, lambda q, v, t: ca.if_else(t > at, 1.0, 0.0)),
        q0=0.0,
        v0=0.0,
        duration=20.0,
    )
    assert_met(motion, lambda t: np.where(t > at, 1 - np.cos(t - at), 0), switches=1, most=80)
    assert np.abs(motion.t - at).min() <= 2 * np.finfo(float).eps


def driven(edges, sides):
    """x'' = −x + f, f piecewise constant, from rest at zero."""

    def exact(times):
        found, x, v = np.zeros(len(times)), 0.0, 0.0
        for begin, end, f in zip(edges[:-1], edges[1:], sides, strict=True):
            some = (times >= begin) & (times <= end)
            s = times[some] - begin
            found[some] = f + (x - f) * np.cos(s) + v * np.sin(s)
            s = end - begin
            x, v = f + (x - f) * np.cos(s) + v * np.sin(s), v * np.cos(s) - (x - f) * np.sin(s)
        return found

    return exact


def test_a_square_wave_drive_is_met_on_every_piece():
    motion = vi.simulate(
        scene(oscillator, lambda q, v, t: ca.sign(ca.sin(2 * t + 0.4))),
        q0=0.0,
        v0=0.0,
        duration=20.0,
    )
    edges = np.concatenate([[0.0], (np.arange(1, 13) * np.pi - 0.4) / 2, [30.0]])
    sides = [(-1.0) ** k for k in range(len(edges) - 1)]
    assert_met(motion, driven(edges, sides), switches=12, most=150)


def test_pulses_by_remainders_and_whole_parts_are_found():
    """Half of every two seconds, for one of which there is a pulse of a thousandth besides."""
    motion = vi.simulate(
        scene(
            oscillator,
            lambda q, v, t: (
                ca.if_else(ca.fmod(t, 2) < 1, 1.0, 0.0)
                + ca.floor(t / 3)
                + ca.if_else(ca.logic_and(t > 2.5, t < 2.501), 1000.0, 0.0)
            ),
        ),
        q0=0.0,
        v0=0.0,
        duration=8.0,
    )
    edges = np.array([0, 1, 2, 2.5, 2.501, 3, 4, 5, 6, 7, 8.0])
    sides = [1, 0, 1, 1001, 1, 1, 2, 1, 3, 2]
    assert_met(motion, driven(edges, sides), switches=9)


def by_pieces(rates, branch, y, duration, surface):
    """Any motion of one coordinate from crossing to crossing, by another integrator."""
    t, ends = 0.0, []
    while True:

        def crossing(t, y, side=branch):
            return surface(y, side)

        crossing.terminal, crossing.direction = True, -1
        piece = solve_ivp(
            lambda t, y, side=branch: rates(t, y, side),
            (t, duration),
            y,
            method="DOP853",
            rtol=1e-13,
            atol=1e-14,
            events=crossing,
            dense_output=True,
        )
        ends.append((t, piece.t[-1], piece.sol))
        t, y = piece.t[-1], piece.y[:, -1]
        if t >= duration:
            return lambda times: np.array(
                [next(sol(s)[0] for a, b, sol in ends if a <= s <= b) for s in times]
            )
        branch = -branch


def test_a_nonlinear_scene_keeps_the_order_of_the_rule_over_its_switches():
    """A pendulum that hits a stiff peg on one side: steps end at the peg."""
    stiff = 400.0
    motion = vi.simulate(
        scene(lambda q, v, _t: v**2 / 2 + ca.cos(q) - stiff / 2 * ca.fmax(q - 0.3, 0) ** 2),
        q0=-1.5,
        v0=0.0,
        duration=15.0,
    )
    exact = by_pieces(
        lambda t, y, side: [y[1], -np.sin(y[0]) - (stiff * (y[0] - 0.3) if side > 0 else 0.0)],
        -1.0,
        [-1.5, 0.0],
        15.0,
        lambda y, side: side * (y[0] - 0.3),
    )
    off = np.abs(motion.q[:, 0] - exact(motion.t)).max()
    assert off < 1e-10 and motion.stats["error_estimate"] <= TOL
    assert np.abs(motion.energy - motion.energy[0]).max() < 1e-10


@pytest.mark.parametrize("tol", [1e-5, 1e-12])
def test_other_tolerances_are_kept_too(tol):
    motion = vi.simulate(
        scene(lambda q, v, _t: v**2 / 2 + ca.cos(q) - ca.fabs(q)),
        q0=1.0,
        v0=0.0,
        duration=9.0,
        tol=tol,
    )
    fine = vi.simulate(
        scene(lambda q, v, _t: v**2 / 2 + ca.cos(q) - ca.fabs(q)),
        q0=1.0,
        v0=0.0,
        duration=9.0,
        tol=1e-13,
    )
    off = np.abs(fine.at(motion.t).q - motion.q).max() / np.ptp(motion.q)
    assert off <= motion.stats["error_estimate"] + fine.stats["error_estimate"]
    assert motion.stats["error_estimate"] <= tol


def test_the_start_may_lie_on_the_switch():
    """At rest where friction holds, and where both sides pull apart from it."""
    held = vi.simulate(
        scene(oscillator, lambda q, v, _t: -0.3 * ca.sign(v)), q0=0.2, v0=0.0, duration=5.0
    )
    assert (held.q == 0.2).all()
    leaves = vi.simulate(
        scene(lambda q, v, _t: v**2 / 2 - ca.fabs(q)), q0=0.0, v0=-0.5, duration=3.0
    )
    first = leaves.t <= 1.0
    arc = -0.5 * leaves.t + leaves.t**2 / 2
    assert np.abs(leaves.q[first, 0] - arc[first]).max() < 1e-13


def test_a_motion_along_a_switch_is_followed():
    """Down a wall of one-sided springs that it only touches."""
    q, v = vi.coordinates("x", "y")
    wall = vi.System(q, v, ca.sumsqr(v) / 2 - 500 * ca.fmax(q[0] - 1, 0) ** 2 - q[1])
    motion = vi.simulate(wall, q0=[1.0, 0.0], v0=[0.0, 1.0], duration=5.0)
    assert (motion.q[:, 0] == 1).all() and motion.stats["error_estimate"] <= TOL
    assert np.abs(motion.q[:, 1] - motion.t + motion.t**2 / 2).max() < 1e-13


def test_switches_at_one_instant_are_passed_together():
    """Into the corner of a box of soft walls along its diagonal: both coordinates alike."""
    q, v = vi.coordinates("x", "y")
    walls = sum(800 * ca.fmax(0, side * q[i] - 1) ** 2 for i in (0, 1) for side in (1, -1))
    motion = vi.simulate(
        vi.System(q, v, ca.sumsqr(v) / 2 - walls), q0=[0.0, 0.0], v0=[1.0, 1.0], duration=7.0
    )
    period = 4 + 2 * np.pi / 40
    s = np.mod(motion.t, period)
    inside, back = 1 + np.sin(40 * (s - 1)) / 40, 2 + np.pi / 40 - s
    late = s - 3 - np.pi / 40
    outside = -1 - np.sin(40 * late) / 40
    x = np.where(s < 1, s, np.where(s < 1 + np.pi / 40, inside, back))
    x = np.where(late > 0, np.where(late < np.pi / 40, outside, s - period), x)
    assert np.abs(motion.q - x[:, None]).max() < 1e-12


def test_events_ends_times_and_nodes_asked_for_are_those_of_the_motion():
    kink = scene(lambda q, v, _t: v**2 / 2 - ca.fabs(q))
    q, v = kink.q, kink.v
    exact, root = parabolas(1.0), 2**0.5
    whole = vi.simulate(
        kink, q0=1.0, v0=0.0, duration=12.0, events={"turn": v, "half": (q - 0.5, 1), "zero": q}
    )
    turns = [event.time for event in whole.events if event.kind == "turn"]
    assert turns == pytest.approx([2 * root, 4 * root, 6 * root, 8 * root], abs=1e-12)
    zeros = [event.time for event in whole.events if event.kind == "zero"]
    assert zeros == pytest.approx([root, 3 * root, 5 * root, 7 * root], abs=1e-12)
    assert [event.kind for event in whole.events].count("half") == 2
    until = vi.simulate(kink, q0=1.0, v0=0.0, duration=12.0, until=(q - 0.5, 1))
    assert until.t[-1] == pytest.approx(4 * root - 1, abs=1e-12)
    times = np.linspace(0, 12, 40)
    at = vi.simulate(kink, q0=1.0, v0=0.0, duration=12.0, at=times)
    assert (at.t == times).all() and np.abs(at.q[:, 0] - exact(times)).max() < 1e-11
    some = vi.simulate(kink, q0=1.0, v0=0.0, duration=12.0, save_every=5)
    assert len(some) < len(whole) / 3 and np.isin(some.t, whole.t).all()
    assert np.abs(some.at(times).q[:, 0] - exact(times)).max() < 1e-11


def test_a_run_backwards_returns():
    kink = scene(lambda q, v, _t: v**2 / 2 - ca.fabs(q) - q**2)
    there = vi.simulate(kink, q0=1.0, v0=0.2, duration=9.0)
    back = vi.simulate(kink, q0=there.q[-1], v0=there.v[-1], t0=9.0, duration=-9.0)
    assert np.abs(back.q[-1] - 1.0).max() < 1e-10 and back.t[-1] == pytest.approx(0, abs=1e-14)
    assert back.stats["switches"] == there.stats["switches"] > 4


def test_the_same_call_gives_the_same_bytes():
    friction = scene(oscillator, lambda q, v, t: ca.sin(t) - 0.4 * ca.sign(v))
    runs = [vi.simulate(friction, q0=1.0, v0=0.0, duration=20.0) for _ in range(2)]
    assert runs[0].q.tobytes() == runs[1].q.tobytes()


def test_pieces_of_linear_scenes_have_the_same_bytes_in_both_gears():
    q, v = vi.coordinates("x", "y")
    L = ca.sumsqr(v) / 2 - ca.sumsqr(q) / 2
    friction = vi.System(q, v, L, force=-0.2 * ca.sign(v))
    start = dict(q0=[0.7, -0.4], v0=[0.1, 0.6], duration=5.0, tol=1e-8)
    one, other = (vi.simulate(friction, **start, backend=b) for b in ("native", "compiled"))
    assert one.t.tobytes() == other.t.tobytes() and one.q.tobytes() == other.q.tobytes()
    assert one.p.tobytes() == other.p.tobytes()


def test_parameters_switch_too():
    c = vi.Parameters(mu=0.15, switch=1.0)
    q, v = vi.coordinates("x")
    system = vi.System(q, v, v**2 / 2 - q**2 / 2, force=-c.mu * c.switch * ca.sign(v), params=c)
    motion = vi.simulate(system, q0=1.0, v0=0.0, duration=20.0, params=dict(mu=0.04))
    assert_met(motion, coulomb(0.04, 1.0)[0])


@pytest.mark.parametrize("step", [-1.0, 0.3, 3.0])
def test_a_step_of_the_potential_refracts_or_reflects(step):
    """Across x = 1 the momentum along it stays, v_x² changes by twice the step; where that is not
    there the motion turns back.
    """
    q, v = vi.coordinates("x", "y")
    scene = vi.System(q, v, ca.sumsqr(v) / 2 - ca.if_else(q[0] > 1, step, 0.0))
    motion = vi.simulate(scene, q0=[0.0, 0.0], v0=[1.0, 0.5], duration=3.0)
    after = (1 - 2 * step) ** 0.5 if step < 0.5 else -1.0
    assert motion.q[-1] == pytest.approx([1 + 2 * after, 1.5], abs=1e-13)
    assert np.ptp(motion.energy) < 1e-14 * max(1, abs(step)) * 10
    assert motion.at(0.5).q == pytest.approx([0.5, 0.25], abs=1e-14)
    assert motion.at(2.0).q == pytest.approx([1 + after, 1.0], abs=1e-13)


def test_a_step_that_moves_does_work():
    """A wall of any height that comes with speed w throws back with −v + 2 w."""
    w = 0.25
    motion = vi.simulate(
        scene(lambda q, v, t: v**2 / 2 - ca.if_else(q > 2 - w * t, 50.0, 0.0)),
        q0=0.0,
        v0=1.0,
        duration=4.0,
    )
    hit = 2 / (1 + w)
    assert motion.v[-1, 0] == pytest.approx(-1 - 2 * w, abs=1e-13)
    assert motion.q[-1, 0] == pytest.approx(hit - (1 + 2 * w) * (4 - hit), abs=1e-12)


def test_a_double_pendulum_with_dry_joints_loses_what_friction_takes():
    """Energy goes by the work of the friction along every piece; both joints hold at the end."""
    q, v = vi.coordinates("a", "b")
    joint = v[1] - v[0]
    lagrangian = v[0] ** 2 + v[1] ** 2 / 2 + ca.cos(q[0] - q[1]) * v[0] * v[1]
    lagrangian += 9.81 * (2 * ca.cos(q[0]) + ca.cos(q[1]))
    mu = 0.9
    dry = mu * ca.sign(joint)
    pendulum = vi.System(q, v, lagrangian, force=ca.vertcat(dry - mu * ca.sign(v[0]), -dry))
    motion = vi.simulate(pendulum, q0=[0.6, 0.3], v0=[0.0, 0.0], duration=16.0)
    assert motion.stats["error_estimate"] <= TOL
    assert np.abs(motion.v[-1]).max() < 1e-12 and motion.stats["switches"] >= 5
    first, second = motion.q[:, 0], motion.q[:, 1] - motion.q[:, 0]
    way = np.abs(np.diff(first)).sum() + np.abs(np.diff(second)).sum()  # turns are nodes
    assert motion.energy[0] - motion.energy[-1] == pytest.approx(mu * way, rel=1e-9)


def test_a_motion_over_switches_travels_to_other_processes_and_into_files(tmp_path):
    """Between nodes as well, where friction holds and where it does not."""
    motion = vi.simulate(
        scene(oscillator, lambda q, v, _t: -0.15 * ca.sign(v)), q0=1.0, v0=0.0, duration=20.0
    )
    exact, times = coulomb(0.15, 1.0)[0], np.linspace(0, 20, 77)
    motion.save(tmp_path / "slide")
    for again in (motion, pickle.loads(pickle.dumps(motion)), vi.load(tmp_path / "slide")):
        assert np.abs(again.at(times).q[:, 0] - exact(times)).max() < 1e-13


def test_files_whose_switches_are_none_of_the_scene_are_refused(tmp_path):
    motion = vi.simulate(
        scene(lambda q, v, _t: v**2 / 2 - ca.fabs(q)), q0=1.0, v0=0.0, duration=6.0
    )
    good = motion.dense_output.to_arrays()
    system, rule = motion.system, motion.rule
    wrong = (
        {"branch": good["branch"] + 7},
        {"branch": good["branch"] * 1.0},
        {"values": np.ones((2, 5))},
        {"held": np.ones_like(good["held"])},
        {"q": good["q"] * np.nan},
        {"t": good["t"][:-1]},
    )
    for part in wrong:
        with pytest.raises(vi.InputError, match="switch"):
            between_nodes(system, rule, good | part)
    smooth = scene(oscillator)
    with pytest.raises(vi.InputError, match="does not have"):
        between_nodes(smooth, rule, good)


def test_derivatives_across_switches_of_the_motion_are_refused_and_those_of_time_are_exact():
    q, v = vi.coordinates("x")
    kinked = vi.simulate(vi.System(q, v, v**2 / 2 - ca.fabs(q)), q0=1.0, v0=0.0, duration=5.0)
    with pytest.raises(vi.InputError, match="jump or kink 2 times"):
        kinked.transition_matrix()
    t = vi.time()
    push = ca.if_else(t > 1, 1.0, 0.0)
    pushed = vi.System(q, v, v**2 / 2 - q**2 / 2, force=push, t=t)
    full = vi.simulate(pushed, q0=1.0, v0=0.0, duration=2 * np.pi)
    assert full.stats["switches"] == 1
    np.testing.assert_allclose(full.transition_matrix(), np.eye(2), atol=1e-9)


@pytest.mark.parametrize("rule", [None, vi.gauss(4)])
@pytest.mark.parametrize(("friction", "rest"), [(0.3, -0.2), (0.05, 0.0)])
def test_friction_that_holds_a_body_is_followed_with_a_given_step_and_told(friction, rest, rule):
    """|x| = 1 − 2 k μ after k half periods, until it is below μ; a step across has no solution."""
    q, v = vi.coordinates("x")
    system = vi.System(q, v, v**2 / 2 - q**2 / 2, force=-friction * ca.sign(v))
    with pytest.warns(UserWarning, match=r"leads across a switch.*duration= or tol="):
        motion = vi.simulate(system, rule, q0=[1.0], v0=[0.0], h=0.1, steps=400)
    grid = 0.1 * np.arange(401)
    assert np.abs(motion.t[:, None] - grid).min(axis=0).max() < 1e-12
    assert len(motion) == 401 + motion.stats["switches"]
    np.testing.assert_allclose([motion.q[-1, 0], motion.v[-1, 0]], [rest, 0], atol=1e-9)


def test_a_step_across_a_jump_of_the_forces_that_fails_is_said_to_be_one():
    """A skate that is rubbed to rest before a wall: beside non-holonomic rows contacts are not
    followed over switches.
    """
    q, v = vi.coordinates("x", "y", "a")
    along = ca.vertcat(ca.cos(q[2]), ca.sin(q[2]), 0)
    system = vi.System(
        q,
        v,
        ca.sumsqr(v[:2]) / 2 + 0.05 * v[2] ** 2,
        nonholonomic=ca.horzcat(-ca.sin(q[2]), ca.cos(q[2]), 0),
        force=-0.3 * ca.sign(ca.dot(along, v)) * along,
        contact=2 - q[0],
        restitution=0.8,
    )
    start = dict(q0=[0, 0, 0.2], v0=[np.cos(0.2), np.sin(0.2), 0.3])
    with pytest.raises(vi.ConvergenceError, match=r"force of the scene jumps.*tanh.*non-holonomic"):
        vi.simulate(system, **start, h=0.01, steps=400)
