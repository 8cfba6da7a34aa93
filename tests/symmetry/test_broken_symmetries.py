"""What breaks a symmetry of the Lagrangian: forces, constraints, walls, rolling."""

from __future__ import annotations

import casadi as ca

import varint as vi


def free_particle(**scene) -> vi.System:
    q, v = vi.coordinates("x", "y")
    return vi.System(q, v, ca.sumsqr(v) / 2, **{k: f(q, v) for k, f in scene.items()})


def broken(system: vi.System) -> dict[str, tuple[str, ...]]:
    return {s.name: s.broken_by for s in vi.symmetries(system)}


def test_a_force_breaks_what_it_does_work_along():
    found = broken(free_particle(force=lambda q, v: ca.vertcat(0, -0.1 * v[1])))
    assert found["translation along x"] == () and found["translation along y"] == ("force",)
    assert found["time translation"] == ("force",)


def test_a_gyroscopic_force_keeps_the_energy():
    found = broken(free_particle(force=lambda q, v: ca.vertcat(v[1], -v[0])))
    assert found["time translation"] == () and found["translation along x"] == ("force",)


def test_a_radial_force_keeps_the_rotation():
    found = broken(free_particle(force=lambda q, v: -q * ca.sumsqr(v)))
    assert found["rotation about z"] == () and found["time translation"] == ("force",)


def test_a_round_constraint_keeps_the_rotation_only():
    found = broken(free_particle(constraint=lambda q, v: ca.sumsqr(q) - 1))
    assert found["rotation about z"] == () == found["time translation"]
    assert all(found[f"translation along {a}"] == ("constraint",) for a in "xy")


def test_a_constraint_need_be_invariant_only_where_it_holds():
    # eˣ (y − 1) changes along x, but not where y = 1
    found = broken(free_particle(constraint=lambda q, v: ca.exp(q[0]) * (q[1] - 1)))
    assert found["translation along x"] == () and found["translation along y"] == ("constraint",)


def test_a_wall_keeps_the_motion_along_it_and_inelastic_impacts_lose_energy():
    found = broken(free_particle(contact=lambda q, v: q[1]))
    assert found["translation along x"] == () and found["translation along y"] == ("contact",)
    assert found["time translation"] == ("contact",)
    q, v = vi.coordinates("x", "y")
    elastic = vi.System(q, v, ca.sumsqr(v) / 2, contact=q[1], restitution=1.0)
    assert broken(elastic)["time translation"] == ()


def test_nonholonomic_reactions_keep_what_lies_in_the_distribution():
    q, v = vi.coordinates("x", "y", "phi")
    skate = vi.System(
        q, v, ca.sumsqr(v) / 2, nonholonomic=ca.horzcat(ca.sin(q[2]), -ca.cos(q[2]), 0)
    )
    found = broken(skate)
    assert found["cyclic coordinate phi"] == () == found["time translation"]
    assert found["translation along x"] == ("nonholonomic",)
