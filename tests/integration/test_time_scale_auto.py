"""The scene's own time scale: steps follow the local rate of the motion and keep its structure."""

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.diagnostics import energy_slope, symplectic_defect
from varint.integration.time_transformation.local_rate import SLOWEST_RATE, local_rate
from varint.integration.time_transformation.time_scale import transformed_scene


def run(model, h, rule=None, **more):
    arguments = {**model.start, "h": h, "time_scale": "auto", "backend": "interpreted"} | more
    return vi.simulate(model.system, rule or vi.gauss(8), **arguments)


def rate(system, q):
    """ω(q) that varint finds."""
    f = ca.Function("rate", [system.q, system.c], [at(system, 0.0)])
    return float(f(q, system.default_vector)) ** 0.5


def at(system, slowest):
    return ca.substitute(local_rate(system).square, SLOWEST_RATE, slowest)


def rate_of(potential, system, q):
    """The same from its definition, tr(A²) of A = −M⁻¹ ∂²V/∂q²."""
    A = ca.solve(system.mass_matrix, ca.hessian(potential, system.q)[0])
    f = ca.Function("rate", [system.q, system.c], [ca.trace(A @ A)])
    return float(f(q, system.default_vector)) ** 0.25


@pytest.mark.parametrize("e", [0.5, 0.9, 0.99])
def test_twenty_steps_an_orbit_are_enough_whatever_the_eccentricity(e):
    model = vi.models.kepler(e=e)
    motion = run(model, 0.9, duration=20 * np.pi)
    assert len(motion) <= 10 * 20
    assert np.abs(motion.q - model.exact(motion.t)[0]).max() < 1e-13 / (1 - e) ** 2 + 1e-11


def test_two_hundred_steps_close_the_orbit_of_the_satellite_of_earth_and_moon():
    model = vi.models.arenstorf()
    motion = run(model, 0.4)
    assert len(motion) < 200
    assert np.abs(motion.q[-1] - model.q0).max() < 4e-10


@pytest.mark.parametrize("name", ["kepler", "two_body", "henon_heiles"])
def test_the_rate_is_that_of_small_motions(name):
    model = vi.models.catalogue[name]()
    s, q = model.system, model.q0 + 0.1
    potential = -ca.substitute(s.lagrangian, s.v, ca.SX.zeros(s.v.numel()))
    assert rate(s, q) == pytest.approx(rate_of(potential, s, q), rel=1e-12)


@pytest.mark.parametrize(
    "terms",
    [
        lambda r, s, x: [1 / r],
        lambda r, s, x: [3 * ca.exp(-r) / r],  # no power of the distance
        lambda r, s, x: [ca.log(s)],
        lambda r, s, x: [1 / r, 2 * s**2],  # taken one by one, so that none hides another
        lambda r, s, x: [-1 / r, (x[0] - 2 * x[1]) ** 2 / 5, x[2] ** 2 / 3],
        lambda r, s, x: [ca.sqrt(1 + x[0] ** 2 + 3 * x[1] ** 2)],  # no distance by this inertia
        lambda r, s, x: [1 / r + x[0] ** 2 * x[1]],  # no function of one form: the whole matrix
    ],
)
def test_each_term_of_the_potential_counts_by_its_own_matrix(terms):
    q, v = vi.coordinates("x", "y", "z")
    s = ca.sumsqr(q - ca.vertcat(0.1, 0.2, 0.3))
    found = terms(ca.sqrt(s), s, q)
    system = vi.System(q, v, 1.5 * ca.sumsqr(v) - sum(found))
    place = [0.7, -0.4, 1.1]
    true = sum(rate_of(term, system, place) ** 2 for term in found) ** 0.5
    assert rate(system, place) == pytest.approx(true, rel=1e-12)


def test_where_a_force_is_steepest_its_rate_does_not_vanish():
    model = vi.models.pendulum(g=9.0)
    for angle in (0.0, 0.3, np.pi / 2, 2.0):
        true = 3 * (np.cos(angle) ** 4 + np.sin(angle) ** 4) ** 0.125
        assert rate(model.system, angle) == pytest.approx(true, rel=1e-12)


def test_the_rate_of_a_frame_that_turns_counts():
    turntable = vi.models.turntable(Omega=0.7).system
    assert "constant" in local_rate(turntable).reason
    centrifugal, coriolis = 2 * 0.7**2, (2 * 0.7) ** 2
    f = ca.Function("rate", [turntable.c], [at(turntable, 0.0)])
    assert float(f(turntable.default_vector)) == pytest.approx(centrifugal + coriolis)


def test_h_is_the_same_number_in_all_units_of_time_and_length():
    model = vi.models.kepler(e=0.9)
    counts = []
    for k, size in ((1.0, 1.0), (16.0, 1.0), (1.0, 100.0)):
        v0 = model.v0 * np.sqrt(k / size)
        turn = 2 * np.pi * np.sqrt(size**3 / k)
        motion = run(model, 0.5, q0=size * model.q0, v0=v0, duration=2 * turn, params={"k": k})
        assert np.abs(motion.q[-1] / size - model.q0).max() < 2e-9
        counts.append(len(motion))
    assert counts[0] == counts[1] == counts[2]


@pytest.mark.parametrize("rule", [vi.gauss(2), vi.lobatto(3)])
def test_the_order_is_that_of_the_rule(rule):
    model = vi.models.kepler(e=0.6)
    errors, steps = [], (0.08, 0.055, 0.04, 0.028)
    for h in steps:
        motion = run(model, h, rule, duration=2 * np.pi)
        errors.append(np.abs(motion.q[-1] - model.exact(motion.t[-1:])[0]).max())
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert abs(slope - rule.order) < 0.15


def test_a_step_of_a_coarse_rule_is_symplectic_and_keeps_all_momenta():
    model = vi.models.two_body()
    motion = run(model, 0.3, vi.gauss(1), duration=10.0)
    assert np.ptp(motion.energy) > 1e-6  # a coarse rule indeed
    for name in ("momentum", "angular momentum"):
        value = motion.value(model.invariants[name]).reshape(len(motion), -1)
        assert np.abs(value - value[0]).max() < 1e-12
    scene, inner = transformed_scene(model.system, "auto"), motion.fictitious
    defect = symplectic_defect(
        scene.system,
        vi.gauss(1),
        q0=inner.q[3],
        p0=inner.p[3],
        h=0.3,
        params={name: float(inner.c[i - 3]) for i, name in enumerate(NAMES)},
    )
    assert defect.passed


NAMES = ("slowest rate", "initial energy", "initial time scale")


def test_a_run_back_returns_to_the_start():
    model = vi.models.kepler(e=0.95)
    there = run(model, 0.6, duration=10 * np.pi)
    back = run(model, -0.6, q0=there.q[-1], v0=there.v[-1], duration=-10 * np.pi)
    assert np.abs(back.q[-1] - model.q0).max() < 1e-10


def test_steps_may_be_counted_and_events_located():
    model = vi.models.kepler(e=0.9)
    motion = run(model, 0.9, duration=None, steps=40, events={"apse": (ca.SX.sym("y"), -1)})
    assert len(motion) == 41
    assert [e.time for e in motion.events[:2]] == pytest.approx([np.pi, 3 * np.pi], rel=1e-12)


def test_where_the_rate_vanishes_steps_stay_bounded():
    model = vi.models.pendulum(theta0=2.5)  # cos θ = 0 twice a swing
    motion = run(model, 0.25, duration=3.0)
    assert np.abs(motion.q - model.exact(motion.t)[0]).max() < 1e-8
    assert np.diff(motion.t).max() < 12 * np.diff(motion.t).min()
    q, v = vi.coordinates("x", "y")
    passing = vi.System(q, v, ca.sumsqr(v) / 2 + 1 / ca.norm_2(q))
    start = dict(q0=[-30, 1.0], v0=[2.0, 0], h=0.2, duration=30.0, time_scale="auto")
    away = vi.simulate(passing, vi.gauss(8), **start)
    fine = vi.simulate(passing, vi.gauss(8), **start | {"h": 0.13})
    assert np.abs(away.q[-1] - fine.q[-1]).max() < 1e-8
    assert np.diff(away.t).max() > 5 * np.diff(away.t).min()


def test_a_constant_rate_means_equal_steps_and_the_plan_says_so():
    model = vi.models.isotropic_oscillator()
    motion = run(model, 0.5, vi.gauss(3))
    assert np.ptp(np.diff(motion.t)) < 1e-12
    omega = rate(model.system, model.q0)
    assert len(motion) - 1 == np.ceil(model.duration * omega / 0.5)
    plain = vi.simulate(
        model.system, vi.gauss(3), **model.start | {"h": motion.h}, backend="interpreted"
    )
    np.testing.assert_array_equal(motion.q, plain.q)
    assert "∂a/∂q is constant" in str(motion.stats["plan"])
    counted = run(model, 0.5, vi.gauss(3), duration=None, steps=10)
    assert counted.t[-1] == pytest.approx(5 / omega)


def refused(name):
    scenes = {
        "mass matrix": lambda: vi.models.double_pendulum().system,
        "magnetic": lambda: vi.models.inverse_distance_field().system,
        "constraints": lambda: vi.models.pendulum_cartesian().system,
    }
    return scenes[name]()


@pytest.mark.parametrize("name", ["mass matrix", "magnetic", "constraints"])
def test_scenes_without_a_rate_of_their_own_are_told_why(name):
    system = refused(name)
    n = system.q.numel()
    with pytest.raises(vi.InputError, match=name):
        vi.simulate(system, q0=np.ones(n), v0=np.ones(n), h=0.1, duration=1.0, time_scale="auto")


def test_other_words_and_free_motions_are_refused():
    q, v = vi.coordinates("x")
    free = vi.System(q, v, v**2 / 2)
    run = dict(q0=1.0, v0=1.0, h=0.1, duration=1.0)
    with pytest.raises(vi.InputError, match="SX expression of q or 'auto'"):
        vi.simulate(free, time_scale="own", **run)
    with pytest.raises(vi.InputError, match="nothing pulls"):
        vi.simulate(free, time_scale="auto", **run)
    quartic = vi.System(q, v, v**2 / 2 - q**4)
    rest = dict(q0=0.0, v0=1.0, h=0.1, time_scale="auto")
    with pytest.raises(vi.InputError, match="give duration"):
        vi.simulate(quartic, steps=10, **rest)
    motion = vi.simulate(quartic, duration=1.0, **rest)
    assert np.abs(motion.energy - 0.5).max() < 1e-5


@pytest.mark.long
@pytest.mark.parametrize("e", [0.9, 0.99])
def test_energy_has_no_slope_over_a_hundred_thousand_encounters(e):
    model = vi.models.kepler(e=e)
    short = run(model, 0.8, duration=2 * np.pi)
    scene, inner = transformed_scene(model.system, "auto"), short.fictitious
    found = energy_slope(
        scene.system,
        vi.gauss(8),
        q0=inner.q[0],
        p0=inner.p[0],
        h=0.8 * (1 + 1e-3 * np.pi),
        steps=100_000 * 16,
        params={name: float(inner.c[i - 3]) for i, name in enumerate(NAMES)},
    )
    assert found.passed
    assert np.abs(found.energy - found.energy[0]).max() < 1e-10
