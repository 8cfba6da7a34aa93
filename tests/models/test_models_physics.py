"""What must come out of the models: symmetries, gauge, frames, averages, periods, attitudes."""

import json
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint import models

FOLDER = Path(__file__).parents[1] / "reference"
A = json.loads((FOLDER / "a.json").read_text())
C = json.loads((FOLDER / "c.json").read_text())
F = json.loads((FOLDER / "f.json").read_text())
FINE = vi.gauss(6)


def run(model, rule=FINE, **changes):
    return vi.simulate(model.system, rule, **model.start | changes)


# central forces
# ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "potential, constants",
    [
        (lambda r, c: -c.k / r, {"k": 1.0}),
        (lambda r, c: c.k * r**2 / 2, {"k": 2.0}),
        (lambda r, c: c.depth * (1 - ca.exp(1 - r)) ** 2, {"depth": 3.0}),
    ],
)
def test_the_angle_of_any_central_force_is_cyclic_and_its_momentum_kept_by_a_coarse_rule(
    potential, constants
):
    model = models.central_force(potential, constants)
    assert model.system.structure.cyclic == (1,)
    motion = run(model, vi.midpoint(), h=0.1)
    assert np.abs(motion.p[:, 1] - motion.p[0, 1]).max() <= 1e-14


def test_the_reduced_radial_problem_gives_the_radius_of_the_plane_motion():
    plane = models.central_force()
    p_theta = float(run(plane).p[0, 1])
    line = models.radial_motion(p_theta)
    assert np.abs(run(plane).q[:, 0] - run(line).q[:, 0]).max() < 1e-12


def test_polar_and_cartesian_coordinates_describe_the_same_motion():
    cartesian = models.kepler(e=0.6)
    polar = models.central_force(r0=cartesian.q0[0], thetadot0=cartesian.v0[1] / cartesian.q0[0])
    a, b = run(cartesian, duration=20.0), run(polar, duration=20.0)
    r, theta = b.q.T
    assert np.abs(a.q - np.stack([r * np.cos(theta), r * np.sin(theta)], -1)).max() < 1e-11


def test_polar_kepler_motion_meets_the_reference():
    entry = A["A01_kepler_e06"]
    times = np.array(entry["times"][:6])
    motion = run(models.central_force(r0=0.4, thetadot0=5.0), h=0.005, duration=20.0).at(times)
    found = np.stack([motion.q[:, 0], motion.v[:, 0]], -1)
    assert np.abs(found - np.array(entry["reference"]["polar"][:6])).max() < 1e-11


def test_apsidal_angle_and_radial_period_of_the_rosette():
    r = A["A01_central_k_b"]["reference"]
    assert abs(models.apsidal_angle(0.8, m=1.0, b=0.04) - r["phi_per_radial_period"]) < 1e-14
    assert abs(models.radial_period(r["energy"], m=1.0, k=1.0) - r["radial_period"]) < 1e-14
    motion = run(models.rosette(), duration=r["radial_period"], h=r["radial_period"] / 500)
    assert abs(motion.q[-1, 1] - r["phi_per_radial_period"]) < 1e-12


# pendulums
# ------------------------------------------------------------------------------


def test_periods_of_pendulums():
    for name in ("A04_inclined_axis_30deg", "A04_inclined_axis_horizontal"):
        r = A[name]["reference"]
        assert abs(models.pendulum_period(2.5, r["omega0"]) / r["libration_period"] - 1) < 1e-14
    for name in ("A02_cart_pendulum_large", "A02_cart_pendulum_rest"):
        p, theta0 = A[name]["params"], A[name]["initial"]["q"][1]
        period = models.sliding_support_period(theta0, M=p["M"], m=p["m"], length=p["l"], g=p["g"])
        assert abs(period / A[name]["reference"]["period_theta"] - 1) < 1e-14
    p, r = A["A03_bead_rotating_hoop"]["params"], A["A03_bead_rotating_hoop"]["reference"]
    assert (
        abs(models.rotating_hoop_period(0.6, p["R"], p["Omega"], p["g"]) / r["period"] - 1) < 1e-14
    )


def test_the_sliding_support_obeys_its_second_equation():
    model = models.sliding_support()
    s = model.system
    rates = ca.solve(
        s.mass_matrix, ca.gradient(s.lagrangian, s.q) - ca.jacobian(s.momentum, s.q) @ s.v
    )
    c = s.params
    law = rates[0] * ca.cos(s.q[1]) + c.length * rates[1] + c.g * ca.sin(s.q[1])
    assert np.abs(run(model).value(law)).max() < 1e-12


def test_small_swings_of_a_chain_have_laguerre_frequencies():
    model = models.chain_pendulum(links=6)
    s = model.system
    stiffness = -ca.hessian(s.lagrangian, s.q)[0]
    matrices = ca.Function("linear", [s.q, s.v, s.c], [s.mass_matrix, stiffness])
    mass, stiff = (x.full() for x in matrices(0, 0, s.default_vector))
    squares = np.sort(np.linalg.eigvals(np.linalg.solve(mass, stiff)).real)
    assert squares / (6 * 9.81) == pytest.approx(
        np.polynomial.laguerre.lagroots([0] * 6 + [1]), rel=1e-12
    )


def test_a_chain_of_two_links_is_the_double_pendulum():
    chain = models.chain_pendulum(links=2)
    double = models.double_pendulum(theta=(0.5, 0.5), m=(0.5, 0.5), length=(0.5, 0.5))
    assert np.abs(run(chain).q - run(double, h=chain.h, duration=chain.duration).q).max() < 1e-11


# turning frames
# ------------------------------------------------------------------------------


def test_a_spring_seen_from_a_turning_frame_is_the_spring_of_the_inertial_frame():
    Omega, stiffness = np.array([0.3, -0.2, 0.9]), 1.69
    seen = models.rotating_frame(Omega=Omega, stiffness=stiffness)
    inertial = models.isotropic_oscillator(seen.q0, seen.v0 + np.cross(Omega, seen.q0), omega=1.3)
    a, b = run(seen), run(inertial, h=seen.h, duration=seen.duration)
    back = models.rotating.turned(a.q, Omega / np.linalg.norm(Omega), np.linalg.norm(Omega) * a.t)
    assert np.abs(back - b.q).max() < 1e-12
    # the momentum of the turning frame is the inertial one
    assert (
        np.abs(
            models.rotating.turned(a.p, Omega / np.linalg.norm(Omega), np.linalg.norm(Omega) * a.t)
            - b.p
        ).max()
        < 1e-12
    )


def test_the_turntable_is_the_frame_turning_about_z():
    flat = models.turntable()
    space = models.rotating_frame(q0=[*flat.q0, 0], v0=[*flat.v0, 0], Omega=(0, 0, 0.7))
    assert np.abs(run(flat).q - run(space, h=flat.h, duration=flat.duration).q[:, :2]).max() < 1e-12


def test_foucaults_plane_of_swing_turns_against_the_frame_at_its_rate():
    # started at the rate −Ω about the vertical, the bob swings in a plane of the inertial frame
    turning = run(
        models.foucault_pendulum(latitude=np.pi / 2, Omega=5e-3, v0=(0.0, -3.0 * 5e-3)),
        duration=400.0,
    )
    angle = np.arctan2(turning.q[:, 1], turning.q[:, 0])
    swing = np.mod(angle + 5e-3 * turning.t + np.pi / 2, np.pi) - np.pi / 2
    assert np.abs(swing[np.hypot(*turning.q.T) > 0.1]).max() < 1e-11


# charged particles and gauge
# ------------------------------------------------------------------------------


@pytest.mark.parametrize("rule", [vi.midpoint(), vi.gauss(2), vi.lobatto(3)], ids=str)
@pytest.mark.parametrize(
    "factory", [models.uniform_fields, models.magnetic_mirror, models.oscillating_field]
)
def test_a_linear_gauge_function_changes_the_momentum_and_not_the_path(factory, rule):
    slope, rate = np.array([0.4, -0.3, 0.2]), 0.7
    plain, other = factory(), factory(gauge=lambda q, t: ca.dot(slope, q) + rate * t)
    a, b = run(plain, rule, duration=100 * plain.h), run(other, rule, duration=100 * plain.h)
    assert np.abs(a.q - b.q).max() < 2e-13
    assert np.abs(b.p - (a.p - slope)).max() < 1e-12


def wavy(q, t):
    """The χ of the reference entry, with the sign of A → A − ∇χ."""
    x, y, z = ca.vertsplit(q)
    return -(0.3 * x**2 * y + 0.5 * ca.sin(x + 2 * z) + 0.25 * t * y + 0.2 * t**2 * z)


@pytest.mark.parametrize("rule", [vi.midpoint(), vi.gauss(2), vi.lobatto(3)], ids=str)
def test_a_general_gauge_function_changes_the_path_by_the_order_of_the_rule(rule):
    r = A["A08_gauge"]
    data = {
        "E": r["params"]["E"],
        "B": r["params"]["B"],
        "q0": r["initial"]["q"],
        "v0": r["initial"]["v"],
    }
    plain, other = models.uniform_fields(**data), models.uniform_fields(**data, gauge=wavy)

    def gap(steps):
        a, b = (run(m, rule, h=2.0 / steps, duration=2.0) for m in (plain, other))
        return np.abs(a.q - b.q).max()

    gaps = np.array([gap(steps) for steps in (40, 80, 160)])
    assert np.log2(gaps[:-1] / gaps[1:]) == pytest.approx([rule.order] * 2, abs=0.15)


def test_momenta_and_actions_in_two_gauges_meet_the_reference():
    r = A["A08_gauge"]
    data = {
        "E": r["params"]["E"],
        "B": r["params"]["B"],
        "q0": r["initial"]["q"],
        "v0": r["initial"]["v"],
    }
    for k, gauge in enumerate((None, wavy)):
        model = models.uniform_fields(**data, gauge=gauge)
        motion = run(model, h=0.02, duration=2.0)
        assert (
            np.abs(motion.at(r["times"]).p - np.array(r["reference"][f"p_gauge{k}"])).max() < 1e-13
        )
        for t, action in zip(r["times"][1:], r["reference"][f"action_gauge{k}"][1:], strict=True):
            assert abs(motion[: round(t / 0.02) + 1].action - action) < 1e-13


def test_the_electric_field_may_sit_in_the_vector_potential():
    E = np.array([0.2, -0.1, 0.05])
    scalar = models.uniform_fields(E=E, v0=(0.7, 0.4, -0.2))
    temporal = models.uniform_fields(E=E, v0=(0.7, 0.4, -0.2), gauge=lambda q, t: ca.dot(E, q) * t)
    assert not temporal.system.structure.autonomous
    assert np.abs(run(scalar).q - run(temporal).q).max() < 1e-12


@pytest.mark.parametrize("name", ["uniform_fields", "magnetic_mirror", "oscillating_field"])
def test_charges_obey_the_lorentz_force(name):
    model = models.catalogue[name]()
    s = model.system
    q, v, t, c = s.q, s.v, s.t, s.params
    p = s.momentum
    rate = ca.gradient(s.lagrangian, q) - ca.jacobian(p, q) @ v - ca.jacobian(p, t)
    A_field = (p - c.m * v) / c.e
    slope = ca.jacobian(A_field, q)
    B = ca.vertcat(slope[2, 1] - slope[1, 2], slope[0, 2] - slope[2, 0], slope[1, 0] - slope[0, 1])
    phi = ca.substitute(-s.lagrangian / c.e, v, ca.SX.zeros(3))
    E = -ca.gradient(phi, q) - ca.jacobian(A_field, t)
    assert (
        np.abs(run(model, duration=100 * model.h).value(rate - c.e * (E + ca.cross(v, B)))).max()
        < 1e-12
    )


def test_the_orbit_in_the_field_of_inverse_distance_turns_by_the_closed_form():
    r = A["A08_field_1_over_r_planar"]["reference"]
    period, angle = models.inverse_distance_period((2.0, 0.0), (0.0, 0.6))
    assert abs(period / r["radial_period"] - 1) < 1e-14
    assert abs(angle / r["phi_per_radial_period"] - 1) < 1e-14


def test_the_magnetic_moment_is_adiabatic():
    mirror = models.magnetic_mirror()
    s = mirror.system
    slow = run(mirror)
    x, y, z = ca.vertsplit(s.q)
    c = s.params
    B = c.B0 * ca.vertcat(-z * x / c.L**2, -z * y / c.L**2, 1 + (z / c.L) ** 2)
    along = ca.dot(s.v, B) / ca.norm_2(B)
    moment = slow.value(c.m * (ca.sumsqr(s.v) - along**2) / (2 * ca.norm_2(B)))
    assert np.ptp(moment) < 0.15 * moment.mean()
    windows = moment[:2000].reshape(10, 200).mean(axis=1)
    assert np.ptp(windows) < 0.02 * moment.mean()


@pytest.mark.filterwarnings("ignore:the Lagrangian is degenerate")
def test_the_guiding_centre_follows_the_particle_to_first_order_in_the_gyroradius():
    def gap(B0):
        radius = 0.6 / B0
        particle = models.magnetic_mirror(q0=(0.1 - radius, 0, 0), B0=B0)
        centre = models.guiding_centre(q0=(0.1, 0, 0), moment=0.18 / B0, B0=B0)
        slow = vi.simulate(centre.system, vi.midpoint(), q0=centre.q0, h=0.02, duration=10.0)
        fast = run(particle, vi.gauss(4), h=0.1 / B0, duration=10.0).at(slow.t)
        difference = np.abs(fast.q - slow.q[:, :3]).max(axis=0)
        assert difference[:2] == pytest.approx([radius] * 2, rel=0.01)
        return difference[2]

    gaps = np.array([gap(B0) for B0 in (20.0, 40.0, 80.0)])
    assert np.log2(gaps[:-1] / gaps[1:]) == pytest.approx([1, 1], abs=0.05)


def test_flux_through_the_orbit_stays_while_the_field_grows():
    model = models.growing_field()
    motion = run(model)
    c = model.system.params
    moment = motion.value(ca.sumsqr(model.system.v) / (c.B0 + c.rate * model.system.t))
    assert motion.value(c.B0 + c.rate * model.system.t)[-1] == pytest.approx(3.0)
    assert np.abs(moment / moment[0] - 1).max() < 0.03


# explicit time
# ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "factory",
    [
        models.driven_pendulum,
        models.horizontal_pivot,
        models.kapitza_pendulum,
        models.lengthening_pendulum,
    ],
)
def test_the_energy_changes_by_the_explicit_time_dependence_alone(factory):
    model = factory()
    s = model.system
    motion = run(model, duration=200 * model.h)
    nodes, weights = np.polynomial.legendre.leggauss(8)
    times = (motion.t[:-1, None] + model.h * (nodes + 1) / 2).ravel()
    power = motion.at(times).value(-ca.jacobian(s.lagrangian, s.t)).reshape(-1, 8)
    gained = np.concatenate([[0], np.cumsum(power @ weights) * model.h / 2])
    size = np.abs(motion.energy).max() + np.abs(motion.value(s.lagrangian)).max()
    assert np.ptp(motion.energy) > 0.01 * size
    assert np.abs(motion.energy - motion.energy[0] - gained).max() < 1e-12 * size


def test_caldirola_kanai_is_the_oscillator_with_friction_as_a_force():
    model = models.caldirola_kanai()
    q, v = vi.coordinates("x")
    c = vi.Parameters(omega=1.5, gamma=0.4)
    rubbed = vi.System(q, v, (v**2 - c.omega**2 * q**2) / 2, force=-c.gamma * v, params=c)
    a, b = run(model), vi.simulate(rubbed, FINE, **model.start)
    assert np.abs(a.q - b.q).max() < 1e-13
    r = A["A10_caldirola_kanai_under"]
    p = np.array(r["reference"]["state"])[:, 2]
    assert np.abs(a.at(r["times"]).p[:, 0] / p - 1).max() < 1e-12


@pytest.mark.parametrize("gamma", [0.4, 3.0, 5.0])
def test_damped_motion_has_its_closed_form_below_at_and_above_critical(gamma):
    model = models.caldirola_kanai(gamma=gamma)
    assert np.abs(run(model, duration=4.0).q - model.exact(np.linspace(0, 4, 201))[0]).max() < 1e-13


def test_the_upright_pendulum_stands_where_the_pivot_shakes_fast_enough():
    g, length, amplitude = 9.81, 1.0, 0.1
    limit = np.sqrt(2 * g * length) / amplitude
    for factor, stands in ((1.15, True), (0.85, False)):
        model = models.kapitza_pendulum(
            theta0=np.pi - 0.05, amplitude=amplitude, Omega=factor * limit
        )
        far = np.abs(run(model, vi.gauss(3), duration=10.0).q - np.pi).max()
        assert (far < 0.5) == stands


def test_the_slow_frequency_of_kapitza_holds_to_second_order_in_the_amplitude():
    def gap(amplitude):
        # over one step of the drive's period P the linear motion about the top is a rotation by ω P
        Omega = 6.0 / amplitude
        model = models.kapitza_pendulum(amplitude=amplitude, Omega=Omega)
        s, period = model.system, 2 * np.pi / Omega
        rule, steps = vi.gauss(6), 40
        flow = vi.step_function(s, rule)
        x = ca.MX.sym("x", 2)
        y = x
        for k in range(steps):
            out = flow(
                q0=y[0], p0=y[1], params=s.default_vector, t=period * k / steps, h=period / steps
            )
            y = ca.vertcat(out["q1"], out["p1"])
        trace = ca.trace(ca.Function("monodromy", [x], [ca.jacobian(y, x)])([np.pi, 0.0]))
        return (
            np.arccos(float(trace) / 2)
            / period
            / models.kapitza_frequency(1.0, 9.81, amplitude, Omega)
            - 1
        )

    gaps = np.abs([gap(0.1), gap(0.05), gap(0.025)])
    assert np.log2(gaps[:-1] / gaps[1:]) == pytest.approx([2, 2], abs=0.15)


def test_energy_over_frequency_of_the_lengthening_pendulum_is_adiabatic():
    model = models.lengthening_pendulum(theta0=0.05, rate=0.02)
    motion = run(model, duration=150.0)
    s, c = model.system, model.system.params
    length = c.length + c.rate * s.t
    swing = c.m * length**2 * s.v**2 / 2 + c.m * c.g * length * (1 - ca.cos(s.q))
    ratio = motion.value(swing * ca.sqrt(length / c.g))
    assert motion.value(length)[-1] == pytest.approx(4.0)
    assert np.abs(ratio / ratio[0] - 1).max() < 0.02


# particles
# ------------------------------------------------------------------------------


def test_bodies_of_the_figure_eight_follow_each_other():
    model = models.figure_eight()
    motion = run(model)
    third = motion[200]
    places = model.q0.reshape(3, 2)
    assert np.abs(third.q.reshape(3, 2) - np.roll(places, -1, axis=0)).max() < 1e-11
    assert np.abs(motion.q[-1] - model.q0).max() < 1e-11


def test_the_sun_and_planets_have_the_published_momenta():
    r = C["C_outer_solar_system"]["reference"]
    model = models.outer_solar_system()
    s = model.system
    values = ca.Function(
        "kept", [s.q, s.v, s.c], [model.invariants[k] for k in ("momentum", "angular momentum")]
    )
    momentum, turning = (x.full()[:, 0] for x in values(model.q0, model.v0, s.default_vector))
    assert np.abs(momentum - r["P"]).max() < 1e-20
    assert np.abs(turning - r["L"]).max() < 1e-18


def test_the_satellite_of_earth_and_moon_is_back_after_its_period():
    model = models.arenstorf()
    arguments = model.start | dict(h=0.5, time_scale="auto", backend="interpreted")
    orbit = vi.simulate(model.system, vi.gauss(8), **arguments)
    assert np.abs(orbit.q[-1] - model.q0).max() < 1e-9
    half = orbit.at(models.ARENSTORF_PERIOD / 2)  # the orbit is its own mirror image in y
    assert abs(half.q[1]) < 1e-10 and abs(half.v[0]) < 1e-9


def test_the_seven_stars_are_where_the_published_solution_has_them():
    r, model = F["F01_pleiades"], models.pleiades()
    assert (model.q0 == r["initial"]["q"]).all() and (model.v0 == r["initial"]["v"]).all()
    motion = run(model, vi.composition("kahan-li8"), h=3 / 8000)
    assert np.abs(motion.q[-1] - r["reference"]["state"][0]).max() < 1e-7


@pytest.mark.long
def test_the_lightest_of_three_bodies_from_rest_escapes_and_leaves_a_pair():
    model = models.pythagorean_three_body()
    arguments = model.start | dict(h=0.4, duration=70.0, time_scale="auto")
    motion = vi.simulate(model.system, vi.gauss(8), **arguments)
    for name in ("momentum", "angular momentum"):
        assert np.abs(motion.value(model.invariants[name])).max() < 1e-12
    assert np.abs(motion.energy - motion.energy[0]).max() < 1e-5
    m = np.array([3.0, 4.0, 5.0])
    q, v = motion.q[-1].reshape(3, 2), motion.v[-1].reshape(3, 2)

    def bound(a, b):  # energy of the relative motion by its reduced mass
        (ma, qa, va), (mb, qb, vb) = (
            (m[i].sum(), m[i] @ q[i] / m[i].sum(), m[i] @ v[i] / m[i].sum()) for i in (a, b)
        )
        return ((va - vb) ** 2).sum() / 2 - (ma + mb) / np.linalg.norm(qa - qb)

    assert bound([1], [2]) < 0 < bound([0], [1, 2])
    near = np.linalg.norm(motion.q[:, 2:4] - motion.q[:, 4:], axis=1)
    assert near.min() < 5e-4 and motion.t[near.argmin()] == pytest.approx(15.83, abs=0.005)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("factory", [models.spring_cluster, models.lennard_jones])
def test_pair_potentials_keep_momenta_in_the_plane_and_in_space_with_a_coarse_rule(factory, d):
    model = factory(d=d) if factory is models.spring_cluster else factory(side=2, d=d)
    motion = run(model, vi.trapezoidal(), duration=400 * model.h)
    assert np.ptp(motion.energy) > 1e-7 * np.abs(motion.energy).max()
    for name in ("momentum", "angular momentum"):
        value = motion.value(model.invariants[name]).reshape(len(motion), -1)
        assert np.abs(value - value[0]).max() < 1e-13


# chains and oscillators
# ------------------------------------------------------------------------------


def test_stiff_springs_exchange_the_published_energies():
    r = C["C_fpu_hlw"]
    model = models.fpu_chain()
    motion = run(model, vi.composition("kahan-li8"), h=0.001, duration=50.0).at(r["times"][:3])
    energies = motion.value(models.fpu_stiff_energies(model))
    assert np.abs(energies - np.array(r["reference"]["I_j"][:3])).max() < 1e-12


def test_a_toda_soliton_keeps_its_shape_and_passes_the_end_of_the_ring():
    model = models.toda_chain(sites=60, kappa=1.0)
    motion = run(model, vi.composition("kahan-li8"), h=0.025, duration=100.0)
    assert motion.t[-1] * np.sinh(1.0) > 60  # sites travelled: once round the ring
    assert np.abs(motion.q - model.exact(motion.t)[0]).max() < 1e-11


def test_henon_heiles_starts_on_the_energy_asked_for():
    for total in (1 / 12, 1 / 8):
        motion = run(models.henon_heiles(total=total), duration=1.0)
        assert abs(motion.energy[0] - total) < 1e-16


# rigid bodies
# ------------------------------------------------------------------------------


def quaternion(angles):
    """Unit quaternion (N, 4) of the Euler angles (φ, θ, ψ): q_z(φ) q_x(θ) q_z(ψ), body to space."""
    phi, theta, psi = np.moveaxis(np.asarray(angles), -1, 0) / 2
    c, s = np.cos(theta), np.sin(theta)
    return np.stack(
        [
            c * np.cos(phi + psi),
            s * np.cos(phi - psi),
            s * np.sin(phi - psi),
            c * np.sin(phi + psi),
        ],
        -1,
    )


def product(a, b):
    a0, a1, b0, b1 = a[..., :1], a[..., 1:], b[..., :1], b[..., 1:]
    return np.concatenate(
        [a0 * b0 - (a1 * b1).sum(-1, keepdims=True), a0 * b1 + b0 * a1 + np.cross(a1, b1)], axis=-1
    )


def gap(a, b):
    """Distance of attitudes: q and −q are the same."""
    return np.minimum(np.abs(a - b).max(axis=-1), np.abs(a + b).max(axis=-1)).max()


@pytest.mark.parametrize(
    "name",
    [
        "A11_euler_top_axis1",
        "A11_euler_top_dzhanibekov",
        "A11_euler_top_generic",
        "A11_symmetric_free_top",
    ],
)
def test_attitudes_of_free_bodies_meet_the_reference(name):
    r = A[name]
    p = r["params"]
    model = models.free_rigid_body(
        p["I"] if "I" in p else [p["I1"], p["I1"], p["I3"]], r["initial"]["omega_body"]
    )
    attitude = quaternion(model.exact(r["times"])[0])
    # the reference starts at the identity, the model with the angular momentum along z
    start = quaternion(model.q0) * [1, -1, -1, -1]
    assert gap(product(start, attitude), np.array(r["reference"]["quaternion"])) < 2e-12


def test_a_heavy_asymmetric_body_meets_the_reference():
    r = A["A11_rigid_body_gnicodes"]
    q0, q1, q2, q3 = r["initial"]["quaternion"]
    plus, minus = np.arctan2(q3, q0), np.arctan2(q2, q1)
    angles = [plus + minus, 2 * np.arctan2(np.hypot(q1, q2), np.hypot(q0, q3)), plus - minus]
    inertia = np.array(r["params"]["I"])
    model = models.heavy_rigid_body(
        inertia, 1.0, angles, np.array(r["initial"]["M_body"]) / inertia
    )
    motion = run(model, h=0.002).at(r["times"][:3])
    values = np.array(r["reference"]["state"])[:3]
    assert gap(quaternion(motion.q), values[:, :4]) < 1e-11
    rates = motion.value(models.body_rates(model.system.q, model.system.v))
    assert np.abs(rates - values[:, 4:]).max() < 1e-11


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 2, 0), (1, 0, 2)])
def test_the_free_bodys_closed_form_holds_for_any_naming_of_the_axes(order):
    order = list(order)
    model = models.free_rigid_body(
        np.array([1.0, 1.7, 2.4])[order], np.array([0.5, 0.3, -0.8])[order]
    )
    motion = run(model, duration=20.0)
    q, v = model.exact(motion.t)
    assert np.abs(motion.q - q).max() < 1e-11
    assert np.abs(motion.v - v).max() < 1e-11


# rules on the two scenes whose discrete motion is known
# --------------------------------------------------------------


def test_discrete_free_fall_is_exact_at_the_nodes():
    r = A["A13_discrete_free_fall"]
    q, v = vi.coordinates("x")
    fall = vi.System(q, v, v**2 / 2 - 9.81 * q)
    for rule in (vi.midpoint(), vi.trapezoidal()):
        motion = vi.simulate(fall, rule, q0=0.0, v0=3.0, h=0.1, steps=5)
        assert np.abs(motion.q[:, 0] - r["reference"]["q_nodes_0_to_5"]).max() < 1e-15
        assert np.abs(motion.p[:, 0] - r["reference"]["p_nodes"]).max() < 1e-14
        assert (
            abs(motion[:2].action - r["reference"]["L_d_midpoint_or_trapezoidal_first_step"])
            < 1e-15
        )


def test_discrete_oscillators_have_their_known_motion():
    entry = A["A13_discrete_oscillator"]["reference"]
    r = entry["results"] | entry
    q, v = vi.coordinates("x")
    oscillator = vi.System(q, v, (v**2 - 1.3**2 * q**2) / 2)
    for rule, name in ((vi.trapezoidal(), "stoermer_verlet"), (vi.midpoint(), "implicit_midpoint")):
        states = next(value for key, value in r.items() if key.startswith(name))
        motion = vi.simulate(oscillator, rule, q0=0.7, p0=-0.2, h=0.1, steps=100)
        for k in (10, 100):
            found = np.array([motion.q[k, 0], motion.p[k, 0]])
            assert np.abs(found - states[f"state_after_{k}"]).max() < 1e-14
    verlet = vi.simulate(oscillator, vi.trapezoidal(), q0=0.7, p0=-0.2, h=0.1, steps=1000)
    modified = verlet.p**2 / 2 + 1.3**2 * (1 - 1.3**2 * 0.1**2 / 4) * verlet.q**2 / 2
    assert np.abs(modified - r["verlet_modified_energy"]).max() < 1e-15
    for stages, angle, _ in r["gauss_collocation_angle_per_step"]:
        motion = vi.simulate(oscillator, vi.gauss(stages), q0=1.0, p0=0.0, h=0.1, steps=1)
        assert abs(np.arctan2(-motion.p[1, 0] / 1.3, motion.q[1, 0]) - angle) < 3e-16
