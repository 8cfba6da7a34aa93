"""What rules make of conserved quantities: kept to round-off where theory says so, lost where it
does not.
"""

from __future__ import annotations

import dataclasses

import casadi as ca
import numpy as np
import pytest

import varint as vi

GALERKIN = [vi.gauss(1), vi.gauss(2), vi.gauss(3), vi.lobatto(2), vi.lobatto(3), vi.lobatto(4)]
COMPOSITIONS = [
    vi.composition("yoshida4"),
    vi.composition("blanes-moan6"),
    vi.composition("kahan-li8"),
]
ROUND_OFF = 1e-11


def magnetic(gauge_function=None) -> vi.System:
    """A charge in a uniform field, a round potential, and a gauge dχ/dt."""
    q, v, t = *vi.coordinates("x", "y"), vi.time()
    lagrangian = ca.sumsqr(v) / 2 + 0.7 * (q[0] * v[1] - q[1] * v[0]) - ca.sumsqr(q) ** 2
    if gauge_function is not None:
        chi = gauge_function(q, t)
        lagrangian += ca.jtimes(chi, q, v) + ca.jacobian(chi, t)
    return vi.System(q, v, lagrangian, t=t)


def landau() -> vi.System:
    q, v = vi.coordinates("x", "y")
    return vi.System(q, v, ca.sumsqr(v) / 2 + 1.3 * q[0] * v[1])


def three_bodies() -> vi.System:
    q, v = vi.coordinates(*(f"{a}{i}" for i in (1, 2, 3) for a in "xy"))
    masses = (1.0, 0.7, 0.4)
    kinetic = sum(m * ca.sumsqr(v[2 * i : 2 * i + 2]) / 2 for i, m in enumerate(masses))
    springs = sum(
        (ca.norm_2(q[2 * i : 2 * i + 2] - q[2 * j : 2 * j + 2]) - 1) ** 2
        for i, j in ((0, 1), (0, 2), (1, 2))
    )
    return vi.System(q, v, kinetic - 2 * springs)


def fall() -> vi.System:
    q, v = vi.coordinates("x", "y")
    return vi.System(q, v, ca.sumsqr(v) - 9.81 * q[1])


BODIES = dict(q0=[1, 0, -0.5, 0.8, -0.4, -0.9], v0=[0.1, 0.5, -0.4, 0.1, 0.6, -0.3])
PLANE = dict(q0=[1.0, 0.2], v0=[0.1, 0.8])


def drifts(system: vi.System, rule: vi.Rule, start: dict, steps: int, h: float = 0.05):
    motion = vi.simulate(system, rule, h=h, steps=steps, save_every=max(steps // 1000, 1), **start)
    return [(m.symmetry, m.kept, m.drift) for m in motion.conserved()]


@pytest.mark.parametrize("rule", GALERKIN, ids=str)
@pytest.mark.parametrize(
    ("system", "start"),
    [
        (landau(), PLANE),
        (magnetic(), PLANE),
        (magnetic(lambda q, t: 0.4 * q[0] * q[1]), PLANE),
        (three_bodies(), BODIES),
        (fall(), PLANE),
    ],
    ids=["landau", "magnetic", "magnetic+gauge", "bodies", "fall"],
)
def test_quantities_of_affine_symmetries_are_kept_to_round_off(system, start, rule):
    checked = 0
    for symmetry, kept, drift in drifts(system, rule, start, 500):
        if symmetry.tau.is_zero():
            assert kept == "exactly" and drift < ROUND_OFF / 10, symmetry.name
            checked += 1
    assert checked >= 1


@pytest.mark.parametrize("rule", COMPOSITIONS, ids=str)
@pytest.mark.parametrize(
    ("system", "start"), [(three_bodies(), BODIES), (fall(), PLANE)], ids=["bodies", "fall"]
)
def test_compositions_keep_translations_rotations_and_boosts(system, start, rule):
    found = [
        (kept, drift)
        for symmetry, kept, drift in drifts(system, rule, start, 500)
        if symmetry.tau.is_zero()
    ]
    assert len(found) >= 4 and all(
        kept == "exactly" and drift < ROUND_OFF / 10 for kept, drift in found
    )


@pytest.mark.parametrize("rule", GALERKIN, ids=str)
def test_a_gauge_term_beyond_the_quadrature_is_kept_to_the_order_only(rule):
    """χ = t x y gives the rotation K = t (x² − y²): dK/dt has degree 2d, one more than the
    quadrature's.
    """
    system = magnetic(lambda q, t: 0.4 * t * q[0] * q[1])
    (turn,) = [x for x in drifts(system, rule, PLANE, 40, h=0.2) if x[0].name == "rotation about z"]
    _, kept, drift = turn
    assert kept == f"to order {rule.order}" and drift > 1e-10


@pytest.mark.parametrize(
    ("system", "rule", "start"),
    [
        (three_bodies(), vi.gauss(2), BODIES),
        (three_bodies(), vi.composition("blanes-moan4"), BODIES),
        (landau(), vi.gauss(2), PLANE),
        (magnetic(), vi.lobatto(2), PLANE),
    ],
    ids=["gauss", "composition", "landau", "lobatto"],
)
def test_what_a_rule_keeps_drifts_less_than_1e_11_over_1e5_steps(system, rule, start):
    kept = [
        (s.name, drift)
        for s, verdict, drift in drifts(system, rule, start, 100_000, 0.02)
        if verdict == "exactly"
    ]
    assert kept and all(drift <= ROUND_OFF for _, drift in kept), kept


def test_energy_is_kept_exactly_by_gauss_rules_for_quadratic_lagrangians_only():
    q, v = vi.coordinates("x", "y")
    linear = vi.System(q, v, (ca.sumsqr(v) - q[0] ** 2 - 3 * q[1] ** 2 + q[0] * q[1]) / 2)
    for rule in GALERKIN:
        (energy,) = drifts(linear, rule, PLANE, 300)
        gauss = rule.name.startswith(("gauss", "midpoint"))
        assert energy[1] == ("exactly" if gauss else f"to order {rule.order}")
        assert (energy[2] < 1e-13) == gauss, rule


@pytest.mark.parametrize(
    "rule", [vi.gauss(2), vi.lobatto(3), vi.gauss(1), vi.trapezoidal()], ids=str
)
def test_forces_change_a_momentum_map_by_the_work_along_its_generator(rule):
    q, v, t = *vi.coordinates("x", "y"), vi.time()
    force = ca.vertcat(-0.2 * v[0] + 0.3 * ca.cos(2 * t), -0.1 * v[1] ** 3)
    system = vi.System(q, v, ca.sumsqr(v) / 2 - ca.sumsqr(q) ** 2 / 4, force=force, t=t)
    motion = vi.simulate(system, rule, h=0.05, steps=400, **PLANE)
    turn = motion.conserved()["rotation about z"]
    assert turn.kept == "broken by force" and abs(turn.change) > 0.05
    assert abs(turn.change - turn.expected_change) < 1e-13 * 400
    assert "expected" in str(turn) and "actual" in str(turn)


def test_the_balance_holds_with_controls_and_with_nodes_several_steps_apart():
    q, v = vi.coordinates("x", "y")
    u = ca.SX.sym("u")
    system = vi.System(
        q, v, ca.sumsqr(v) / 2 - q[1] ** 4, force=ca.vertcat(u * ca.cos(q[1]), 0), control=u
    )
    controls = np.sin(np.arange(100))[:, None]
    motion = vi.simulate(system, vi.gauss(2), h=0.05, steps=100, u=controls, save_every=7, **PLANE)
    shift = motion.conserved()["translation along x"]
    assert abs(shift.change) > 0.01 and shift.drift < 1e-14


def test_a_composition_obeys_the_balance_too():
    q, v = vi.coordinates("x", "y")
    system = vi.System(
        q, v, ca.sumsqr(v) / 2 - ca.sumsqr(q) ** 2, force=ca.vertcat(-q[1], 0.5 * q[0])
    )
    motion = vi.simulate(system, vi.composition("blanes-moan4"), h=0.05, steps=200, **PLANE)
    turn = motion.conserved()["rotation about z"]
    assert abs(turn.change) > 0.1 and turn.drift < 1e-13


def test_a_broken_symmetry_is_seen_to_break():
    q, v = vi.coordinates("x", "y")
    drag = vi.System(q, v, ca.sumsqr(v) / 2, force=-0.1 * v)
    shift = vi.simulate(drag, vi.gauss(2), h=0.1, steps=100, **PLANE).conserved()[
        "translation along x"
    ]
    assert (
        not shift.symmetry.conserved and abs(shift.values[-1] / shift.values[0] - np.exp(-1)) < 1e-8
    )


def on_a_slope() -> vi.System:
    """A bead on a straight rod, with gravity along −y."""
    q, v = vi.coordinates("x", "y")
    return vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[1], constraint=0.6 * q[0] + 0.8 * q[1] - 1)


def cartesian_pendulum(drag: float = 0.0) -> vi.System:
    q, v = vi.coordinates("x", "y")
    force = {"force": -drag * v} if drag else {}
    return vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[1], constraint=ca.sumsqr(q) - 1, **force)


def knife_edge() -> vi.System:
    """Slides along its heading only; the rows of a non-holonomic constraint."""
    q, v = vi.coordinates("x", "y", "phi")
    rows = ca.horzcat(ca.sin(q[2]), -ca.cos(q[2]), 0)
    return vi.System(q, v, ca.sumsqr(v) / 2 + q[0], nonholonomic=rows)


HELD = [
    (on_a_slope(), vi.lobatto(2), [5 / 3, 0], [0.8, -0.6]),
    (on_a_slope(), vi.lobatto(3), [5 / 3, 0], [0.8, -0.6]),
    (cartesian_pendulum(), vi.lobatto(2), [1, 0], [0, 0.5]),
    (cartesian_pendulum(), vi.lobatto(4), [1, 0], [0, 0.5]),
    (cartesian_pendulum(drag=0.3), vi.lobatto(2), [1, 0], [0, 0.5]),
    (cartesian_pendulum(drag=0.3), vi.lobatto(3), [1, 0], [0, 0.5]),
    (knife_edge(), vi.midpoint(), [0, 0, 0.3], [0, 0, 0.65]),
    (knife_edge(), vi.lobatto(2), [0, 0, 0.3], [0, 0, 0.65]),
]


@pytest.mark.parametrize(("system", "rule", "q0", "v0"), HELD)
@pytest.mark.parametrize("every", [1, 9])
def test_reactions_change_a_momentum_map_by_their_impulses_along_its_generator(
    system, rule, q0, v0, every
):
    motion = vi.simulate(system, rule, q0=q0, v0=v0, h=0.02, steps=300, save_every=every)
    found = [m for m in motion.conserved() if m.exact and m.symmetry.broken_by]
    assert len(found) >= 2
    for m in found:
        assert m.drift < 1e-13 and abs(m.change) > 1e-3
        moved = dataclasses.replace(motion, p=motion.p * (1 + 1e-9 * motion.t[:, None]))
        assert moved.momentum_map(m.symmetry).drift > 1e-11  # the balance is able to fail


def test_impacts_change_a_momentum_map_by_their_impulses():
    q, v = vi.coordinates("x", "y")
    ball = vi.System(
        q, v, ca.sumsqr(v) / 2 - 9.81 * q[1], contact=q[1] - 0.2 * ca.sin(q[0]), restitution=0.8
    )
    motion = vi.simulate(ball, q0=[0, 1], v0=[0.4, 0], h=0.01, steps=300)
    assert len(motion.events) >= 3 and motion.stats["iterations"] >= 0
    for name in ("translation along x", "translation along y", "time translation"):
        m = motion.conserved()[name]
        assert m.symmetry.broken_by == ("contact",) and m.drift < 1e-13 and abs(m.change) > 0.1
        assert motion[50:].conserved()[name].drift < 1e-13
        # impacts lie between the nodes
        assert motion[::2].conserved()[name].drift < 1e-13


def test_a_rod_without_weight_moves_uniformly():
    q, v = vi.coordinates("x", "y")
    bead = vi.System(q, v, ca.sumsqr(v) / 2, constraint=0.6 * q[0] + 0.8 * q[1] - 1)
    motion = vi.simulate(
        bead,
        vi.trapezoidal(),
        q0=[5 / 3, 0],
        v0=[0.8, -0.6],
        h=0.1,
        steps=100,
        backend="interpreted",
    )
    np.testing.assert_allclose(motion.q[-1], [5 / 3 + 8, -6], rtol=1e-13)


@pytest.mark.parametrize("rule", [vi.gauss(2), vi.lobatto(3)], ids=str)
def test_a_quantity_that_is_zero_does_not_drift(rule):
    """Its terms are round-off too: a motion in the plane z = 0, and bodies at rest."""
    q, v = vi.coordinates("x", "y", "z")
    system = vi.System(q, v, (1 + ca.sumsqr(q)) * ca.sumsqr(v) / 2 - ca.sumsqr(q) ** 2)
    start = dict(h=0.05, steps=2000, backend="interpreted", progress=False)
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    for q0, v0 in (
        ([1, 0, 0], [0, 0.5, 0]),
        (turn @ [1, 0, 0], turn @ [0, 0.5, 0]),
        (turn @ [0, 0, 0], [0, 0, 0]),
    ):
        for m in vi.simulate(system, rule, q0=q0, v0=v0, **start).conserved():
            assert not m.symmetry.tau.is_zero() or m.drift < 1e-13, m
    body = vi.models.free_rigid_body()
    rest = vi.simulate(body.system, rule, q0=body.q0, v0=[0, 0, 0], **start)
    assert max(m.drift for m in rest.conserved()) < 1e-13
    moved = dataclasses.replace(rest, p=rest.p + 1e-6 * np.arange(len(rest))[:, None] / len(rest))
    assert moved.conserved()["cyclic coordinate phi"].drift > 1e-11


def test_the_self_test_of_a_scene_in_uniform_fields_raises_no_alarm():
    model = vi.models.uniform_fields()
    found = vi.diagnostics.self_test(
        model.system, vi.lobatto(3), q0=model.q0, v0=model.v0, h=model.h, steps=300
    )
    assert found.passed and found.momenta, str(found)


def test_symmetries_of_other_systems_and_parameter_values_are_refused():
    q, v = vi.coordinates("x", "y")
    k = vi.Parameters(kx=1.0, ky=1.0)
    system = vi.System(q, v, (ca.sumsqr(v) - k.kx * q[0] ** 2 - k.ky * q[1] ** 2) / 2, params=k)
    turn = vi.symmetries(system, params={})["rotation about z"]
    motion = vi.simulate(system, vi.gauss(2), h=0.1, steps=10, params=dict(kx=2.0), **PLANE)
    with pytest.raises(vi.InputError, match="other parameter values"):
        motion.momentum_map(turn)
    with pytest.raises(vi.InputError, match="another system"):
        motion.momentum_map(vi.symmetries(landau())[0])
    with pytest.raises(vi.InputError, match="takes a Symmetry"):
        motion.momentum_map("rotation about z")
    assert len(motion.conserved()) == 1


def test_momentum_maps_are_drawn():
    conserved = vi.simulate(three_bodies(), vi.gauss(1), h=0.05, steps=50, **BODIES).conserved()
    (axes,) = conserved.plot().axes
    assert len(axes.lines) == 6
    values, error = conserved["rotation about z"].plot().axes
    assert values.get_title() == "rotation about z" and len(error.lines) == 1
    assert "actual change" in str(conserved)
