"""Variable steps by a time scale: same motion, physical times, structure kept, steps where they
are needed.
"""

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.diagnostics import energy_slope, symplectic_defect
from varint.integration.time_transformation.time_scale import transformed_scene

PER_ORBIT = 12


def kepler(e):
    """Model, σ = r^{3/2}, and the fictitious step of twelve steps an orbit: τ = ∫ dt/σ over one
    orbit.
    """
    model = vi.models.kepler(e=e)
    E = 2 * np.pi * np.arange(20_000) / 20_000  # the trapezoidal rule is exact for what is periodic
    turn = 2 * np.pi * np.mean((1 - e * np.cos(E)) ** -0.5)
    return model, vi.close_encounters(ca.norm_2(model.system.q)), turn / PER_ORBIT


def orbits(e, count=10, rule=None, fraction=1.0, **more):
    model, scale, h = kepler(e)
    rule = vi.gauss(8) if rule is None else rule
    arguments = (
        dict(q0=model.q0, v0=model.v0, h=h * fraction, duration=2 * np.pi * count, time_scale=scale)
        | more
    )
    return model, vi.simulate(model.system, rule, **arguments)


@pytest.mark.parametrize(("e", "bound"), [(0.6, 1e-13), (0.9, 1e-12), (0.99, 2e-10)])
def test_twelve_steps_an_orbit_reach_round_off_whatever_the_eccentricity(e, bound):
    model, motion = orbits(e)
    error = np.abs(motion.q - model.exact(motion.t)[0]).max()
    assert len(motion) <= 10 * PER_ORBIT + 3
    assert motion.t[-1] == pytest.approx(20 * np.pi, rel=1e-15)
    assert error < bound  # the start's last digit moves the phase by 1/(1 − e)² of itself an orbit


def test_fixed_steps_of_the_same_cost_have_no_digit_and_say_so():
    model = vi.models.kepler(e=0.9)
    start = dict(q0=model.q0, v0=model.v0, duration=20 * np.pi, steps=10 * PER_ORBIT)
    with pytest.warns(UserWarning, match="the energy went"):
        motion = vi.simulate(model.system, vi.gauss(8), **start)
    assert np.abs(motion.q - model.exact(motion.t)[0]).max() > 0.1


@pytest.mark.parametrize("rule", [vi.gauss(1), vi.gauss(2), vi.lobatto(3)])
def test_the_order_is_that_of_the_rule(rule):
    errors, fractions = [], (0.1, 0.07, 0.05, 0.035)
    for fraction in fractions:
        model, motion = orbits(0.6, 1, rule, fraction)
        errors.append(np.abs(motion.q[-1] - model.exact(motion.t[-1:])[0]).max())
    slope = np.polyfit(np.log(fractions), np.log(errors), 1)[0]
    assert abs(slope - rule.order) < 0.15


def test_dense_output_is_at_the_requested_physical_times():
    model, motion = orbits(0.9, 3, t0=5.0)
    times = np.linspace(5, 5 + 6 * np.pi, 101)
    found = motion.at(times)
    assert (found.t == times).all()
    assert np.abs(found.q - model.exact(times - 5)[0]).max() < 1e-12
    assert motion.at(7.0).t == 7.0


def test_saving_fewer_nodes_changes_neither_motion_nor_dense_output():
    _, every = orbits(0.9, 3)
    _, few = orbits(0.9, 3, save_every=5)
    times = np.linspace(0, 6 * np.pi, 23)
    assert len(few) < len(every) / 4
    assert np.abs(few.q[-1] - every.q[-1]).max() < 1e-12
    assert np.abs(few.at(times).q - every.at(times).q).max() < 1e-12


@pytest.mark.parametrize("every", [1, 7, 200, 10**6])
@pytest.mark.parametrize("duration", [0.3, 20.0, 1000.0])
def test_nodes_are_those_of_one_run_however_it_was_followed(duration, every):
    """The end is looked for in pieces; the nodes are multiples of save_every and the end all the
    same.
    """
    model, scale, h = kepler(0.6)
    run = dict(q0=model.q0, v0=model.v0, h=h, time_scale=scale, backend="interpreted")
    rule = vi.gauss(3)
    motion = vi.simulate(model.system, rule, duration=duration, save_every=every, **run)
    steps = int(motion.k[-1])
    whole = vi.simulate(model.system, rule, steps=steps + 1, **run)
    assert whole.t[steps] <= duration < whole.t[steps + 1]
    assert motion.t[-1] == pytest.approx(duration, rel=1e-14)
    assert motion.k[:-1].tolist() == list(range(0, steps + 1, every))
    assert np.abs(motion.q[:-1] - whole.q[motion.k[:-1]]).max() < 1e-11
    assert np.abs(motion.q[-1] - whole.at(duration).q).max() < 1e-11


def test_the_step_is_symplectic_with_time_among_the_coordinates():
    model, scale, h = kepler(0.9)
    scene = transformed_scene(model.system, scale)
    defect = symplectic_defect(
        scene.system,
        vi.gauss(3),
        q0=[*model.q0, 0],
        p0=[*model.v0, 1],
        h=h,
        params={"initial energy": -0.5},
    )
    assert defect.passed


def test_a_run_back_returns_to_the_start():
    model, there = orbits(0.9, 5)
    _, scale, h = kepler(0.9)
    back = vi.simulate(
        model.system,
        vi.gauss(8),
        q0=there.q[-1],
        p0=there.p[-1],
        h=-h,
        duration=-10 * np.pi,
        time_scale=scale,
    )
    assert np.abs(back.q[-1] - model.q0).max() < 1e-10
    assert back.t[-1] == pytest.approx(-10 * np.pi, rel=1e-15)


def test_momenta_and_energy_are_those_of_the_scene_itself():
    model, motion = orbits(0.9)
    spin = motion.value(model.invariants["angular momentum"])
    assert np.abs(spin - spin[0]).max() < 1e-14
    assert np.abs(motion.energy - motion.energy[0]).max() < 1e-12
    # ⟨2T⟩ − E by the virial theorem
    assert motion.action == pytest.approx(1.5 * 20 * np.pi, rel=1e-11)


def test_constrained_scenes_keep_their_constraint_and_physical_multipliers():
    q, v = vi.coordinates("x", "y")
    rod = vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[1], constraint=ca.sumsqr(q) - 1)
    motion = vi.simulate(
        rod,
        vi.lobatto(4),
        q0=[1, 0],
        v0=[0, 0],
        h=0.02,
        duration=3.0,
        time_scale=1 / ca.sqrt(2 - q[1]),
    )
    assert np.abs(motion.value(rod.constraint)).max() < 1e-12
    tension = 3 * 9.81 * -motion.q[:, 1]  # T = m v² − m g y/ℓ with v² = −2 g y
    assert np.abs(-2 * motion.multipliers[:, 0] - tension).max() < 1e-6
    assert motion.t[-1] == pytest.approx(3.0, rel=1e-15)


def test_parameters_may_enter_the_time_scale():
    c = vi.Parameters(k=1.0)
    q, v = vi.coordinates("x", "y")
    system = vi.System(q, v, ca.sumsqr(v) / 2 + c.k / ca.norm_2(q), params=c)
    scale = ca.norm_2(q) ** 1.5 / ca.sqrt(c.k)
    run = dict(q0=[0.4, 0], time_scale=scale, h=0.5)
    slow = vi.simulate(system, vi.gauss(8), v0=[0, 2.0], duration=10.0, **run)
    fast = vi.simulate(system, vi.gauss(8), v0=[0, 4.0], duration=5.0, params={"k": 4.0}, **run)
    assert np.abs(slow.q[-1] - fast.q[-1]).max() < 1e-13


def test_a_saved_run_is_read_back_with_its_dense_output(tmp_path):
    _, motion = orbits(0.9, 1)
    motion.save(tmp_path / "orbit.npz")
    again = vi.load(tmp_path / "orbit.npz")
    assert (again.at([1.0, 2.0]).q == motion.at([1.0, 2.0]).q).all()
    assert again.action == motion.action


def test_crossings_are_located_in_physical_time():
    _, motion = orbits(
        0.6, until=vi.models.kepler(0.6).system.v[1], events={"apse": (ca.SX.sym("y"), -1)}
    )
    assert motion.t[-1] == pytest.approx(np.pi / 2 - 0.6, abs=1e-13)  # E = π/2
    _, motion = orbits(0.6, 2, events={"apse": (ca.SX.sym("y"), -1)})
    assert [event.time for event in motion.events] == pytest.approx([np.pi, 3 * np.pi], rel=1e-13)
    assert [event.energy_before for event in motion.events] == pytest.approx(
        [-0.5, -0.5], rel=1e-13
    )


def test_several_close_pairs_are_weighted_smoothly():
    r = ca.SX.sym("r", 2)
    scale = ca.Function("scale", [r], [vi.close_encounters(r)])
    assert float(scale([1e-4, 1.0])) == pytest.approx(1e-6, rel=1e-7)
    assert float(scale([1.0, 1.0])) == pytest.approx(2**-0.75)


def test_time_scales_that_are_none_are_refused():
    q, v = vi.coordinates("x")
    free = vi.System(q, v, v**2 / 2 - q**2 / 2)
    run = dict(q0=1.0, v0=0.0)
    with pytest.raises(vi.InputError, match="positive"):
        vi.simulate(free, time_scale=-q, h=0.1, duration=1.0, **run)
    with pytest.raises(vi.ConvergenceError, match="too close to zero") as told:
        vi.simulate(free, time_scale=0.5 + q, h=0.1, duration=20.0, **run)
    reached = told.value.trajectory
    assert reached.t[-1] == told.value.time and np.abs(reached[:50].energy - 0.5).max() < 1e-4
    with pytest.raises(vi.InputError, match="not on"):
        vi.simulate(free, time_scale=1 + v**2, h=0.1, duration=1.0, **run)
    with pytest.raises(vi.InputError, match="unknown symbols"):
        vi.simulate(free, time_scale=ca.SX.sym("z"), h=0.1, duration=1.0, **run)
    with pytest.raises(vi.InputError, match="fictitious"):
        vi.simulate(free, time_scale=1 + q**2, steps=10, duration=1.0, **run)
    with pytest.raises(vi.InputError, match="same sign"):
        vi.simulate(free, time_scale=1 + q**2, h=0.1, duration=-1.0, **run)


def test_a_time_scale_leaves_nothing_undone_in_silence(tmp_path):
    model, scale, h = kepler(0.6)
    for more in (dict(checkpoint=tmp_path / "run"), dict(on_failure="subdivide")):
        with pytest.raises(vi.InputError, match=next(iter(more))):
            vi.simulate(
                model.system, q0=model.q0, v0=model.v0, h=h, steps=9, time_scale=scale, **more
            )


@pytest.mark.long
def test_energy_has_no_slope_over_a_hundred_thousand_orbits():
    model, scale, h = kepler(0.9)
    scene = transformed_scene(model.system, scale)
    found = energy_slope(
        scene.system,
        vi.gauss(8),
        q0=[*model.q0, 0],
        p0=[*model.v0, 1],
        h=h * (1 + 1e-3 * np.pi),
        steps=100_000 * PER_ORBIT,
        params={"initial energy": -0.5},
    )
    assert found.passed
    drift = np.abs(found.energy - found.energy[0]).max()
    assert drift < 1e-11


@pytest.mark.parametrize("every", [1, 100, 2000])
def test_a_run_of_few_saved_nodes_is_judged_as_one_of_many(every):
    model = vi.models.double_pendulum()
    scale = 1 + model.system.q[0] ** 2 / 10
    start = dict(q0=model.q0, v0=model.v0, h=0.005, steps=2000, save_every=every)
    motion = vi.simulate(model.system, vi.gauss(4), time_scale=scale, **start)
    assert np.abs(motion.energy - motion.energy[0]).max() <= 1e-6 * np.abs(motion.energy[0])


def test_no_way_out_is_advised_that_a_time_scale_does_not_take():
    """A hyperbola with σ = r² ends at infinity after a finite fictitious time."""
    q, v = vi.coordinates("x", "y")
    system = vi.System(q, v, ca.sumsqr(v) / 2 + 1 / ca.norm_2(q))
    start = dict(q0=[1, 0], v0=[0, 2.0], h=0.05, duration=50.0, time_scale=ca.sumsqr(q))
    with pytest.raises(vi.ConvergenceError, match="smaller h") as error:
        vi.simulate(system, vi.gauss(4), **start)
    assert "subdivide" not in str(error.value)
    with pytest.raises(vi.InputError, match="on_failure"):
        vi.simulate(system, vi.gauss(4), **start, on_failure="subdivide")
