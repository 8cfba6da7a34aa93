"""Contacts in a known order as phases: impacts, reactions that only push, hopping with given
durations; against closed forms, balances, and simulations that find the contacts themselves.
"""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np
import pytest
from control_scenes import U, coarse, particle, replay_defect

import varint as vi

G, BODY, FOOT = 9.81, 1.0, 0.25
BOTH = BODY + FOOT
REDUCED = BODY * FOOT / BOTH


@cache
def hopper() -> vi.System:
    """A body over a foot of mass, an actuator between them, and the ground."""
    q, v = vi.coordinates("body", "foot")
    kinetic = (BODY * v[0] ** 2 + FOOT * v[1] ** 2) / 2
    lagrangian = kinetic - G * (BODY * q[0] + FOOT * q[1])
    return vi.System(q, v, lagrangian, contact=q[1], force=ca.vertcat(U, -U), control=U)


STAND, AIR, LAND = 0.4, 0.45, 0.3


@cache
def hop() -> list[vi.Trajectory]:
    """From rest up, through the air, and down to rest, in given times; the leg lands as long as it
    was.
    """
    s, rest = hopper(), dict(q=[0.5, 0], v=[0, 0])
    lands = dict(bounds=[(0.5, s.q[0] - s.q[1], 0.5)])
    phases = [
        vi.Phase(s, vi.lobatto(4), STAND, 4, U**2, start=rest, closed=[0]),
        vi.Phase(s, vi.gauss(3), AIR, 4, U**2, end=lands),
        vi.Phase(s, vi.lobatto(4), LAND, 4, U**2, end=dict(q=[0.5, None], v=[0, None]), closed=[0]),
    ]
    return vi.optimal_phases(phases)


def least_squares(way: float, change: float, duration: float) -> float:
    """Least ∫ a² dt from rest by a way to a velocity."""
    squares = 12 * way**2 / duration**2 - 12 * way * change / duration + 4 * change**2
    return squares / duration


def least_hop() -> float:
    """Three least squares, of the body while it stands, f = m (a + g), and of the leg's length in
    the air, f = μ l''; a quadratic in the height at which it takes off and in the velocity at which
    the leg lands. The ballistic flight gives the others.
    """

    def cost(x: np.ndarray) -> float:
        height, swing = x
        v = (0.5 + G * AIR**2 * BOTH / (2 * BODY) - height) / AIR
        w = v - G * AIR + REDUCED / BODY * (swing - v)  # of the body when it lands
        up = G**2 * STAND + 2 * G * v + least_squares(height - 0.5, v, STAND)
        down = G**2 * LAND - 2 * G * w + 4 * w**2 / LAND
        leg = least_squares(0.5 - height - v * AIR, swing - v, AIR)
        return BODY**2 * (up + down) + REDUCED**2 * leg

    e, zero = np.eye(2), np.zeros(2)
    slope = np.array([(cost(d) - cost(-d)) / 2 for d in e])
    curve = np.array([[cost(a + b) - cost(a) - cost(b) + cost(zero) for b in e] for a in e])
    return cost(-np.linalg.solve(curve, slope))


def test_a_hop_with_given_phases_costs_what_its_closed_form_says():
    motions = hop()
    assert sum(m.cost for m in motions) == pytest.approx(least_hop(), rel=1e-10)
    stand, air, land = motions
    assert air.q[:, 1].min() >= -1e-12
    assert min(stand.multipliers.min(), land.multipliers.min()) > 0
    weight = FOOT * G + np.array([stand.u_at(t)[0] for t in stand.t])
    assert stand.multipliers[:, 0] == pytest.approx(weight, rel=1e-9)


def test_the_foot_that_lands_takes_its_own_momentum_and_energy_only():
    _, air, land = hop()
    assert land.q[0] == pytest.approx(air.q[-1], abs=1e-12)
    assert land.p[0, 0] == pytest.approx(air.p[-1, 0], rel=1e-12)
    fall = air.v[-1, 1]
    assert fall < -1
    assert air.energy[-1] - land.energy[0] == pytest.approx(FOOT * fall**2 / 2, rel=1e-9)
    assert max(replay_defect(m) for m in hop()) <= 1e-12


def test_the_simulation_with_contacts_takes_off_and_lands_where_the_phases_do():
    """It finds both events itself; the controls of the phases, held as functions of time."""
    stand, air, land = hop()
    s = hopper()

    def push(t):
        for m in (stand, air):
            if t <= m.t[-1]:
                return m.u_at(t)[0]
        return land.u_at(t)[0]

    n, h = 1150, 0.001
    nodes = np.array(vi.trapezoidal().nodes)
    eps = 1e-9  # either side of a jump
    u = np.array(
        [[[push((k + c) * h + (eps if c == 0 else -eps))] for c in nodes] for k in range(n)]
    )
    seen = vi.simulate(s, vi.trapezoidal(), q0=[0.5, 0], v0=[0, 0], h=h, steps=n, u=u)
    assert [event.kind for event in seen.events] == ["detachment", "stop"]
    times = [event.time for event in seen.events]
    assert times == pytest.approx([STAND, STAND + AIR], abs=1e-5)
    assert seen.q[-1] == pytest.approx([0.5, 0], abs=1e-5)


def test_a_ball_thrown_at_a_target_by_one_bounce_is_what_the_simulation_sees():
    q, v = vi.coordinates("x", "y")
    ball = vi.System(q, v, ca.sumsqr(v) / 2 - G * q[1], contact=q[1], restitution=0.8)
    throw = dict(start=dict(q=[0, 1], v=[2.0, None]))
    phases = [
        vi.Phase(ball, vi.gauss(2), vi.free(0.5, 0.1, 2), 4, **throw),
        vi.Phase(ball, vi.gauss(2), vi.free(0.5, 0.1, 2), 4, end=dict(q=[2.5, 0.5])),
    ]
    links = [vi.Link(0, 1, contact=ball.contact, restitution=0.8)]
    down, up = vi.optimal_phases(phases, links)
    end = down.duration + up.duration
    assert up.v[0] == pytest.approx([down.v[-1, 0], -0.8 * down.v[-1, 1]], rel=1e-10)
    assert up.energy[0] - down.energy[-1] == pytest.approx(-0.18 * down.v[-1, 1] ** 2, rel=1e-9)
    seen = vi.simulate(ball, vi.trapezoidal(), q0=down.q[0], v0=down.v[0], duration=end, steps=50)
    assert seen.q[-1] == pytest.approx([2.5, 0.5], abs=1e-9)
    assert seen.events[0].time == pytest.approx(down.duration, abs=1e-10)


def test_a_reaction_that_would_pull_bounds_the_control():
    """Down fast: the body falls with at most g (1 + m₂/m₁), or the foot would be lifted."""
    s = hopper()
    given = dict(
        duration=0.35,
        steps=20,
        cost=U**2,
        q0=[1.0, 0],
        v0=[0, 0],
        end=dict(q=[0.65, None], v=[0, None]),
    )
    held = vi.optimal_control(s, vi.lobatto(3), closed=[0], **given)
    assert any("reaction of contact 0 >= 0" in name for name in held.solution.active)
    alone, w = vi.coordinates("body")
    scene = vi.System(alone, w, BODY * w**2 / 2 - BODY * G * alone, force=U, control=U)
    bare = vi.optimal_control(
        scene,
        vi.lobatto(3),
        **given | dict(q0=[1.0], v0=[0], end=dict(q=[0.65], v=[0])),
        bounds=[(-FOOT * G, U, None)],
    )
    assert held.cost == pytest.approx(bare.cost, rel=1e-9)
    assert held.q[:, 0] == pytest.approx(bare.q[:, 0], abs=1e-8)


def test_an_open_contact_is_a_floor_for_the_path():
    q, v = vi.coordinates("y")
    s = vi.System(q, v, v**2 / 2, contact=q, force=U, control=U)
    given = dict(duration=1.0, steps=20, cost=U**2, q0=0.1, v0=-1.0, end=dict(q=[0.1], v=[1.0]))
    floor = vi.optimal_control(s, vi.gauss(2), **given)
    bound = vi.optimal_control(particle(), vi.gauss(2), **given, bounds=[(0, particle().q, None)])
    assert floor.q.min() >= -1e-10
    assert floor.cost == pytest.approx(bound.cost, rel=1e-8)
    free = vi.optimal_control(particle(), vi.gauss(2), **given)
    assert free.cost < 0.9 * floor.cost


def test_constraints_that_begin_to_hold_stop_the_motion_across_them():
    """Two scenes instead of a contact: a bob in flight is caught by its rod, v⁺ = v − n n·v."""
    q, v = vi.coordinates("x", "y")
    free, rod = (
        vi.System(q, v, ca.sumsqr(v) / 2 - G * q[1], constraint=rows)
        for rows in (None, (ca.sumsqr(q) - 1) / 2)
    )
    phases = [
        vi.Phase(free, vi.gauss(2), vi.free(0.3, 0.05, 2), 5, start=dict(q=[0.3, 0.2], v=[1.0, 0])),
        vi.Phase(rod, vi.lobatto(3), vi.free(0.2, 0.2, 1), 5, 1),
    ]
    flight, swing = vi.optimal_phases(phases)
    n, before, after = flight.q[-1], flight.v[-1], swing.v[0]
    assert n @ n == pytest.approx(1, abs=1e-12)
    assert after == pytest.approx(before - n * (n @ before), abs=1e-10)
    lost = flight.energy[-1] - swing.energy[0]
    assert lost == pytest.approx((n @ before) ** 2 / 2, rel=1e-9)
    assert np.abs((swing.q**2).sum(axis=1) - 1).max() <= 1e-11
    assert replay_defect(swing) <= 1e-11


def test_a_blade_that_is_set_down_stops_the_motion_across_it():
    q, v = vi.coordinates("x", "y", "phi")
    blade = ca.horzcat(ca.sin(q[2]), -ca.cos(q[2]), 0)
    kinetic = ca.sumsqr(v) / 2
    glide, skate = (vi.System(q, v, kinetic, nonholonomic=rows) for rows in (None, blade))
    start = dict(q=[0, 0, 0.4], v=[1.0, 0.5, 0.3])
    one, two = vi.optimal_phases(
        [
            vi.Phase(glide, vi.midpoint(), vi.free(0.5, 0.5, 0.6), 4, 1, start=start),
            vi.Phase(skate, vi.midpoint(), vi.free(0.5, 0.5, 1), 20, 1),
        ]
    )
    phi = one.q[-1, 2]
    across = np.array([np.sin(phi), -np.cos(phi), 0])
    assert two.v[0] == pytest.approx(one.v[-1] - across * (across @ one.v[-1]), abs=1e-10)


def test_reactions_are_those_of_the_motion_and_bound_it():
    q, v = vi.coordinates("x", "y")
    bob = vi.System(q, v, ca.sumsqr(v) / 2 - G * q[1], constraint=(ca.sumsqr(q) - 1) / 2)
    motion = vi.simulate(bob, q0=[0, -1], v0=[2.0, 0], h=0.01, steps=100)
    found = ca.Function("reaction", [q, v], [vi.reactions(bob)])
    values = [float(found(x, y)) for x, y in zip(motion.q, motion.v, strict=True)]
    assert values == pytest.approx(motion.multipliers[:, 0], rel=1e-9)
    exact = -((motion.v**2).sum(axis=1) - G * motion.q[:, 1])  # m v²/ℓ + m g cos θ, pulling
    assert values == pytest.approx(exact, rel=1e-9)
    # a rope: the slowest turn over the top keeps it taut, v² = g there
    over = vi.optimal_control(
        bob,
        vi.lobatto(4),
        duration=vi.free(1.0, 0.3, 3.0),
        steps=20,
        cost=0,
        terminal_cost=-bob.t,
        start=dict(q=[0, -1]),
        end=dict(q=[0, 1]),
        bounds=[(None, vi.reactions(bob)[0], 0)],
        guess=dict(q=lambda t: [np.sin(np.pi * t), -np.cos(np.pi * t)]),
    )
    assert (over.v[-1] ** 2).sum() == pytest.approx(G, rel=1e-5)


@coarse
def test_what_contacts_cannot_do_is_refused():
    s = hopper()
    given = dict(duration=0.3, steps=3, cost=U**2, q0=[0.5, 0], v0=[0, 0])
    for closed, message in (
        ([1], r"closed=\[1\].*those of this scene are \[0\]"),
        ([0, 0], "each once"),
        ("a", "numbers of contacts"),
        (0, "numbers of contacts"),
        ([0.5], "numbers of contacts"),
    ):
        with pytest.raises(vi.InputError, match=message):
            vi.optimal_control(s, closed=closed, **given)
    with pytest.raises(vi.InputError, match="this scene has none"):
        vi.optimal_control(particle(), closed=[0], duration=1.0, steps=3, cost=U**2)
    phases = [
        vi.Phase(s, None, 0.3, 3, U**2, start=dict(q=[0.5, 0.1], v=[0, 0])),
        vi.Phase(s, None, 0.3, 3, U**2, closed=[0]),
    ]
    with pytest.raises(vi.InputError, match="does not bounce"):
        vi.optimal_phases(phases, [vi.Link(0, 1, contact=s.contact, restitution=0.5)])
    for contact in ("", object()):
        with pytest.raises(vi.InputError, match="the contact of a link must be"):
            vi.optimal_phases(phases, [vi.Link(0, 1, contact=contact)])
    with pytest.raises(vi.InputError, match="nothing holds this one"):
        vi.reactions(s)
    q, v = vi.coordinates("y")
    relativistic = vi.System(q, v, -ca.sqrt(1 - v**2), contact=q, force=U, control=U)
    with pytest.raises(vi.InputError, match="quadratic in the velocities"):
        vi.optimal_control(relativistic, duration=1.0, steps=3, cost=U**2)
