"""Test particles: a mass of zero is refused with what to do, and what to do is the exact limit."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import varint as vi

M = 0.01
START = dict(q0=[-M, 0, 1 - M, 0, 0.4, 0], v0=[0, -M, 0, 1 - M, 0, 1.5])
Q, V = vi.coordinates("x1", "y1", "x2", "y2", "x", "y")


def field():
    return (1 - M) / ca.norm_2(Q[4:6] - Q[0:2]) + M / ca.norm_2(Q[4:6] - Q[2:4])


def bodies():
    kinetic = ((1 - M) * ca.sumsqr(V[0:2]) + M * ca.sumsqr(V[2:4])) / 2
    return kinetic + M * (1 - M) / ca.norm_2(Q[0:2] - Q[2:4])


def restricted():
    pull = ca.vertcat(ca.SX.zeros(4), ca.gradient(field(), Q[4:6]))
    return vi.System(Q, V, bodies() + ca.sumsqr(V[4:6]) / 2, force=pull)


def with_mass(mass, **more):
    return vi.System(Q, V, bodies() + mass * (ca.sumsqr(V[4:6]) / 2 + field()), **more)


@pytest.mark.parametrize("given", ["number", "parameter"])
def test_a_body_without_mass_is_refused_with_what_to_do(given):
    c = vi.Parameters(m=0.0)
    system = with_mass(0.0) if given == "number" else with_mass(c.m, params=c)
    with pytest.raises(
        vi.InputError, match=r"mass of \['x', 'y'\] is zero.*massless_limit.*unit mass"
    ):
        vi.simulate(system, vi.gauss(2), **START, h=0.05, steps=10)


def test_other_directions_without_inertia_are_no_test_particles():
    q, v = vi.coordinates("x", "y")
    system = vi.System(q, v, (v[0] + v[1]) ** 2 / 2 - ca.sumsqr(q))
    with pytest.raises(vi.InputError, match=r"gives no inertia to .*other coordinates"):
        vi.simulate(system, vi.gauss(2), q0=[1, 0], v0=[0, 0], h=0.1, steps=1)


@pytest.mark.parametrize("rule", [vi.gauss(3), vi.composition("suzuki4")], ids=str)
def test_a_force_on_a_unit_mass_is_the_limit_of_small_masses(rule):
    """Step for step: the difference is the mass itself, times what the motion makes of it."""
    run = dict(h=0.05, steps=200, **START)
    light, none = (vi.simulate(s, rule, **run) for s in (with_mass(1e-9), restricted()))
    assert 1e-12 < np.abs(light.q - none.q).max() < 1e-7
    lighter = vi.simulate(with_mass(1e-12), rule, **run)
    np.testing.assert_allclose(lighter.q, none.q, rtol=0, atol=1e-10)


def test_jacobis_integral_of_a_test_particle_does_not_drift():
    motion = vi.simulate(restricted(), vi.gauss(4), **START, h=0.05, steps=2000)
    jacobi = motion.value(ca.sumsqr(V[4:6]) / 2 - field() - (Q[4] * V[5] - Q[5] * V[4]))
    assert np.abs(jacobi - jacobi[0]).max() < 1e-11
    np.testing.assert_allclose(
        motion.q[:, 2], (1 - M) * np.cos(motion.t), rtol=0, atol=1e-9
    )  # the bodies do not feel it


def ring(test_bodies: int, masses=None) -> tuple[vi.System, vi.Parameters, np.ndarray, np.ndarray]:
    """Two bodies and some light ones in space, all of which attract each other; a start."""
    q, v = vi.coordinates(*(f"{axis}{i}" for i in range(2 + test_bodies) for axis in "xyz"))
    c = vi.Parameters(heavy=[1 - M, M], light=np.zeros(test_bodies) if masses is None else masses)
    mass = ca.vertsplit(ca.vertcat(c.heavy, c.light))
    place, speed = ca.vertsplit(q, 3), ca.vertsplit(v, 3)
    lagrangian = sum(m * ca.sumsqr(x) / 2 for m, x in zip(mass, speed, strict=True))
    for i in range(len(mass)):
        for j in range(i):
            lagrangian += mass[i] * mass[j] / ca.norm_2(place[i] - place[j])
    angle = np.arange(test_bodies) * 2.1 + 1
    around = 0.5 * np.stack([np.cos(angle), np.sin(angle), 0.1 * np.cos(angle)], 1)
    turn = 1.4 * np.stack([-np.sin(angle), np.cos(angle), 0 * angle], 1)
    q0 = np.concatenate([[-M, 0, 0, 1 - M, 0, 0], around.ravel()])
    v0 = np.concatenate([[0, -M, 0, 0, 1 - M, 0], turn.ravel()])
    return vi.System(q, v, lagrangian, params=c), c, q0, v0


@pytest.mark.parametrize("rule", [vi.gauss(2), vi.composition("suzuki4")], ids=str)
def test_the_massless_limit_is_that_of_small_masses(rule):
    system, c, q0, v0 = ring(3)
    run = dict(q0=q0, v0=v0, h=0.02, steps=150)
    limit = vi.simulate(vi.massless_limit(system, c.light), rule, **run)
    errors = []
    for size in (1e-6, 1e-8):
        light = vi.simulate(system, rule, **run, params={"light": size * np.array([1, 2, 3])})
        errors.append(np.abs(light.q - limit.q).max())
    assert errors[0] < 1e-3 and 50 < errors[0] / errors[1] < 200  # linear in the masses


def test_test_particles_move_neither_the_others_nor_each_other():
    """To the last digit by an explicit rule, whose bodies do not share an iteration."""
    rule, run = vi.composition("suzuki4"), dict(h=0.02, steps=150)
    many, c, q0, v0 = ring(4)
    limit = vi.simulate(vi.massless_limit(many, c.light), rule, q0=q0, v0=v0, **run)
    none, _, r0, w0 = ring(0)
    alone = vi.simulate(none, rule, q0=r0, v0=w0, **run)
    np.testing.assert_array_equal(limit.q[:, :6], alone.q)
    one, own, r0, w0 = ring(1)
    first = vi.simulate(vi.massless_limit(one, own.light), rule, q0=r0, v0=w0, **run)
    np.testing.assert_array_equal(limit.q[:, 6:9], first.q[:, 6:9])
    implicit = vi.simulate(vi.massless_limit(many, c.light), vi.gauss(3), q0=q0, v0=v0, **run)
    bodies_alone = vi.simulate(none, vi.gauss(3), q0=q0[:6], v0=v0[:6], **run)
    np.testing.assert_allclose(implicit.q[:, :6], bodies_alone.q, rtol=0, atol=1e-14)
    energy = bodies_alone.energy
    heavy = none.energy  # of the others, along the limit's motion
    kept = ca.Function("energy", [none.q, none.v, none.c], [heavy])
    along = [
        float(kept(q[:6], v[:6], [1 - M, M])) for q, v in zip(implicit.q, implicit.v, strict=True)
    ]
    np.testing.assert_allclose(along, energy, rtol=0, atol=1e-14)


def test_pairs_of_test_particles_cost_nothing():
    sizes = []
    for count in (5, 10, 20):
        system, c, _, _ = ring(count)
        limit = vi.massless_limit(system, c.light)
        force = ca.Function("force", [limit.q, limit.c], [limit.force])
        sizes.append(force.n_instructions())
    assert sizes[2] - sizes[1] <= 2.2 * (sizes[1] - sizes[0])  # linear in their number


def test_a_bead_without_mass_on_a_wire_keeps_to_it_and_moves_no_one():
    q, v = vi.coordinates("x", "y", "a", "b")
    c = vi.Parameters(m=0.0)
    lagrangian = ca.sumsqr(v[:2]) / 2 - ca.sumsqr(q[:2]) / 2 + c.m * ca.sumsqr(v[2:]) / 2
    lagrangian -= c.m * ca.sumsqr(q[2:] - q[:2]) / 2
    wire = vi.System(q, v, lagrangian, constraint=q[2] - q[3] ** 2, params=c)
    start = dict(q0=[1.0, 0, 0, 0], v0=[0, 0.5, 0, 1.0], h=0.05, steps=100)
    limit = vi.simulate(vi.massless_limit(wire, c.m), vi.lobatto(3), **start)
    small = vi.simulate(wire, vi.lobatto(3), **start, params={"m": 1e-9})
    assert np.abs(limit.q[:, 2] - limit.q[:, 3] ** 2).max() < 1e-12
    np.testing.assert_allclose(small.q, limit.q, rtol=0, atol=1e-6)


def refused(which: str) -> tuple[vi.System, ca.SX]:
    q, v = vi.coordinates("x", "y")
    c = vi.Parameters(m=0.0, n=0.0)
    own, light = v[0] ** 2 / 2 - q[0] ** 2 / 2, c.m * (v[1] ** 2 / 2 - (q[1] - q[0]) ** 2)
    if which == "parameters":
        return vi.System(q, v, own + light, params=c), ca.SX.sym("k")
    if which == "loses its inertia":
        return vi.System(q, v, own + light + v[1] ** 2, params=c), c.m
    if which == "acts on":
        return vi.System(q, v, own + light - q[1] ** 2, params=c), c.m
    if which == "force that does not vanish":
        return vi.System(q, v, own + light, force=ca.vertcat(0, -v[1]), params=c), c.m
    if which == "how the others move":
        return vi.System(q, v, own + c.m * (v[0] + v[1]) ** 2 / 2, params=c), c.m
    if which == "more than one of these masses":
        return vi.System(q, v, own + light + c.n * v[1] ** 2, params=c), ca.vertcat(c.m, c.n)
    return vi.System(q, v, own + light, constraint=q[0] - q[1], params=c), c.m


@pytest.mark.parametrize(
    "which",
    [
        "parameters",
        "loses its inertia",
        "acts on",
        "force that does not vanish",
        "how the others move",
        "more than one of these masses",
        "a constraint or contact ties",
    ],
)
def test_what_has_no_limit_is_refused_with_what_to_do(which):
    with pytest.raises(vi.InputError, match=which):
        vi.massless_limit(*refused(which))
