"""Families of paths: bounds, several solutions, closed paths, given energy, least time,
derivatives.
"""

import casadi as ca
import numpy as np
import pytest
from references import entries
from scenes import pendulum

import varint as vi

REFERENCE = entries("b")


def reference(name):
    return REFERENCE[name]["params"], REFERENCE[name]["reference"]


def free_particle():
    q, v = vi.coordinates("x", "y")
    return vi.System(q, v, ca.sumsqr(v) / 2)


# --- bounds


def taut(rule, steps):
    """From (−2, 0) to (2, 0) in unit time past the unit disc."""
    scene = free_particle()
    return vi.least_action(
        scene,
        rule,
        q_start=[-2, 0],
        q_end=[2, 0],
        duration=1.0,
        steps=steps,
        guess=[[-2, 0], [0, 1.2], [2, 0]],
        bounds=[(1, ca.sumsqr(scene.q), np.inf)],
    )


def test_a_path_round_an_obstacle_touches_it_with_positive_multiplier_and_no_penetration():
    length = 2 * np.sqrt(3) + np.pi / 3
    path = taut(vi.gauss(1), 400)
    contact = path.solution
    assert path.action == pytest.approx(length**2 / 2, rel=1e-5)
    assert contact.values.min() > 1 - 1e-9
    assert contact.multipliers.min() > -1e-6
    held = contact.touches[:, 0]
    angle = np.arctan2(path.q[held, 1], path.q[held, 0])
    assert np.abs(angle[[0, -1]] - [np.pi / 2 + np.pi / 6, np.pi / 2 - np.pi / 6]).max() < 0.03
    inside = contact.multipliers[held][3:-3, 0]
    assert inside == pytest.approx(length**2 / 2, rel=1e-4)  # v²/R = 2 λ R towards the centre
    assert not held[:100].any() and not held[-100:].any()
    with pytest.raises(vi.InputError, match="leans on its bounds"):
        path.is_minimum  # noqa: B018


def test_the_length_round_an_obstacle_converges_with_order_two():
    exact = (2 * np.sqrt(3) + np.pi / 3) ** 2 / 2
    errors = [abs(taut(vi.gauss(1), n).action - exact) for n in (40, 160, 640)]
    assert np.log(errors[0] / errors[2]) / np.log(16) == pytest.approx(2.0, abs=0.15)


def test_bounds_that_are_not_met_leave_the_stationary_path_alone():
    scene = free_particle()
    ends = dict(q_start=[0, 0], q_end=[1, 2], duration=1.0, steps=10)
    path = vi.least_action(
        scene, vi.gauss(2), bounds=[(-5, scene.q[0], 5), (None, ca.sumsqr(scene.q), 50)], **ends
    )
    assert path.action == pytest.approx(2.5, rel=1e-9)
    assert np.abs(path.solution.multipliers).max() < 1e-7


def test_a_bounded_coordinate_is_held_and_its_multiplier_is_the_force():
    q, v = vi.coordinates("x")
    thrown = vi.System(q, v, v**2 / 2 - 9.81 * q)
    path = vi.least_action(
        thrown, vi.gauss(1), q_start=0.0, q_end=0.0, duration=2.0, steps=200, bounds=[(None, q, 2)]
    )
    assert path.q.max() <= 2 + 1e-9
    held = path.solution.touches[:, 0]
    assert held.sum() > 10
    # leans on the upper bound
    assert path.solution.multipliers[held][3:-3, 0] == pytest.approx(-9.81, rel=1e-6)
    leave = np.sqrt(2 * 2 / 9.81)  # tangent to the ceiling: v = 0 there
    assert abs(path.t[held][0] - leave) < 0.05 and abs(path.t[held][-1] - (2 - leave)) < 0.05


def test_a_minimum_with_constraints_and_bounds_keeps_both():
    q, v = vi.coordinates("x", "y", "z")
    sphere = vi.System(q, v, ca.sumsqr(v) / 2, constraint=ca.sumsqr(q) - 1)
    a, b = np.array([np.cos(0.5), np.sin(0.5), 0]), np.array([-np.cos(0.5), np.sin(0.5), 0])
    path = vi.least_action(
        sphere,
        vi.lobatto(3),
        q_start=a,
        q_end=b,
        duration=1.0,
        steps=40,
        guess=[a, [0, 0.8, 0.6], b],
        bounds=[(0.3, q[2] + ca.sumsqr(q[:2]) - q[1] ** 2 - 0.0, None)],
    )
    assert np.abs((path.q**2).sum(axis=1) - 1).max() < 1e-9
    assert path.solution.values[1:-1].min() > 0.3 - 1e-9
    assert path.solution.touches.any()


def test_bounds_that_contradict_each_other_on_the_way_fail_with_ipopts_word():
    q, v, t = *vi.coordinates("x"), vi.time()
    scene = vi.System(q, v, v**2 / 2, t=t)
    with pytest.raises(vi.SolverError, match="contradict") as caught:
        vi.least_action(
            scene,
            vi.gauss(1),
            q_start=0.0,
            q_end=1.0,
            duration=1.0,
            steps=10,
            bounds=[(None, q, 1), (0, q - 10 * t * (1 - t), None)],
        )
    assert caught.value.status == "Infeasible_Problem_Detected"
    assert len(caught.value.iterate) == 11


# --- several paths


def test_many_starts_find_all_five_paths_of_the_pendulum():
    given, exact = reference("B01_pendulum_bvp")
    found = vi.paths(
        pendulum(),
        vi.gauss(4),
        q_start=given["theta0"],
        q_end=given["theta1"],
        duration=given["T"],
        steps=60,
        starts=20,
        spread=3.0,
    )
    wanted = sorted(exact["solutions"], key=lambda solution: solution["action"])
    assert len(found) == len(wanted) == 5
    for path, solution in zip(found, wanted, strict=True):
        assert path.action == pytest.approx(solution["action"], abs=1e-10)
        assert path.v[[0, -1], 0] == pytest.approx([solution["v0"], solution["v_end"]], abs=1e-10)
        assert path.morse_index == solution["morse_index"] == len(path.conjugate_times)
    assert found[0].v[0, 0] == pytest.approx(1.9995687, abs=1e-7)  # the least of all


def test_winding_numbers_lead_once_round_in_both_directions():
    scene = pendulum()
    found = vi.paths(
        scene,
        vi.gauss(4),
        q_start=0.0,
        q_end=1.0,
        duration=10.0,
        steps=60,
        starts=3,
        winding=dict(theta=[-1, 0, 1]),
    )
    assert {round((path.q[-1, 0] - 1) / (2 * np.pi)) for path in found} == {-1, 0, 1}
    assert [path.action for path in found] == sorted(path.action for path in found)
    assert all(np.abs(np.remainder(path.q[-1], 2 * np.pi) - 1).max() < 1e-12 for path in found)
    with pytest.raises(vi.InputError, match="phi"):
        vi.paths(scene, q_start=0, q_end=1, duration=1.0, steps=3, winding=dict(phi=[0]))


# --- closed paths and given energy


def eight(times):
    """A crude figure-eight: sines, three bodies a third of the period apart."""
    phases = [times + k / 3 for k in range(3)]
    return np.stack(
        [x for s in phases for x in (np.sin(2 * np.pi * s), 0.4 * np.sin(4 * np.pi * s))], axis=1
    )


def turned():
    """Each body takes the place of the next."""
    return np.kron(np.roll(np.eye(3), 1, axis=1), np.eye(2))


@pytest.mark.parametrize(
    ("share", "symmetry"), [(1, None), (3, turned())], ids=["whole period", "third of a period"]
)
def test_the_figure_eight_is_found_from_sines_by_its_period_and_by_its_energy(share, symmetry):
    _, exact = reference("B04_figure_eight")
    scene, rule, steps = vi.models.figure_eight().system, vi.gauss(5), 48 // share
    closed = dict(
        steps=steps, periodic=True, symmetry=symmetry, guess=eight(np.linspace(0, 1 / share, 40))
    )
    orbit = vi.least_action(scene, rule, duration=exact["period"] / share, **closed)
    assert orbit.action * share == pytest.approx(exact["action_one_period"], rel=1e-11)
    assert orbit.energy[0] == pytest.approx(exact["energy"], rel=1e-10)
    level = vi.least_action(scene, rule, energy=exact["energy"], **closed)
    assert level.duration * share == pytest.approx(exact["period"], abs=1e-9)
    for path in (orbit, level):
        again = vi.simulate(scene, rule, q0=path.q[0], p0=path.p[0], h=path.h, steps=share * steps)
        assert np.abs(again.q[-1] - path.q[0]).max() < 1e-9
        assert np.abs(again.p[-1] - path.p[0]).max() < 1e-9
    # Chenciner and Montgomery: least among the choreographies, though not among all closed paths
    assert orbit.is_minimum == (share == 3)


def test_an_oscillation_of_given_energy_has_its_period():
    energy = 0.4 - 1.0  # amplitude: cos θ = 0.6
    motion = vi.least_action(
        pendulum(),
        vi.gauss(6),
        energy=energy,
        steps=30,
        periodic=True,
        guess=np.sin(np.linspace(0, 2 * np.pi, 30))[:, None],
    )
    from varint.models import pendulum_period

    assert motion.duration == pytest.approx(pendulum_period(np.arccos(-energy), 1.0), rel=1e-9)
    assert np.abs(motion.energy - energy).max() < 1e-9


def test_a_rotation_closes_after_a_turn():
    turn = vi.least_action(
        pendulum(),
        vi.gauss(6),
        duration=3.0,
        steps=30,
        periodic=True,
        symmetry=[[1.0, 2 * np.pi]],
        guess=np.linspace(0, 2 * np.pi, 9)[:, None],
    )
    assert turn.q[-1, 0] - turn.q[0, 0] == pytest.approx(2 * np.pi, rel=1e-14)
    assert turn.p[-1, 0] == pytest.approx(turn.p[0, 0], rel=1e-13)
    period = 4 * np.pi / 2 / turn.duration  # mean speed; faster below than above
    assert turn.p.min() < period < turn.p.max()


def test_a_closed_path_stays_closed_on_disk(tmp_path):
    motion = vi.least_action(
        pendulum(),
        vi.gauss(4),
        duration=7.0,
        steps=20,
        periodic=True,
        guess=np.sin(np.linspace(0, 2 * np.pi, 30))[:, None],
    )
    assert np.ptp(motion.q) > 1
    motion.save(tmp_path / "closed.npz")
    again = vi.load(tmp_path / "closed.npz")
    assert (again.closure == motion.closure).all()
    assert again.morse_index == motion.morse_index
    assert motion[:5].closure is None


def test_a_path_of_given_energy_takes_the_time_of_the_thrown_ball():
    q, v = vi.coordinates("x", "y")
    ball = vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[1])
    speed, angle = 10.0, 1.1  # the high throw
    flight = 2 * speed * np.sin(angle) / 9.81
    far = speed * np.cos(angle) * flight
    path = vi.least_action(
        ball,
        vi.gauss(2),
        q_start=[0, 0],
        q_end=[far, 0],
        energy=speed**2 / 2,
        steps=10,
        duration=vi.free(1.5 * flight, 0.1, 10.0),
    )
    assert path.duration == pytest.approx(flight, rel=1e-12)
    assert path.v[0] == pytest.approx([speed * np.cos(angle), speed * np.sin(angle)], rel=1e-12)


# --- least time, least length


@pytest.mark.parametrize("case", ["unit", "dymos", "halfcycloid", "long"])
def test_the_brachistochrone_is_the_cycloid(case):
    given, exact = reference(f"B03_brachistochrone_{case}")
    model = vi.models.brachistochrone(given["X"], given["Y_drop"], given["g"])
    deep = np.sqrt(2 * given["Y_drop"])
    s = np.linspace(0, 1, 30)[:, None]
    path = vi.least_action(
        model.system,
        vi.gauss(4),
        q_start=[0, 0],
        q_end=[given["X"], deep],
        steps=20,
        guess=np.hstack([given["X"] * s, deep * np.sqrt(s)]),
        duration=vi.free(exact["time_straight_line"], 0.01, 100.0),
    )
    assert path.action == pytest.approx(exact["T"], rel=1e-10)
    assert path.duration == pytest.approx(exact["T"], rel=1e-8)
    x, y, _ = exact["x_y_v_at_T_over_2"]
    assert [path.q[10, 0], path.q[10, 1] ** 2 / 2] == pytest.approx([x, y], rel=1e-7)


@pytest.mark.parametrize("case", ["cops", "symmetric"])
def test_the_catenary_of_given_length_has_its_potential_energy(case):
    given, exact = reference(f"B03_catenary_{case}")
    span, length = given.get("span", 1.0), given["L"]
    path = vi.least_action(
        vi.models.catenary().system,
        vi.gauss(6),
        energy=0.0,
        duration=vi.free(2.0, 0.01, 100.0),
        steps=30,
        q_start=[0.0, given["a"], 0.0],
        q_end=[span, given["b"], length],
    )
    assert path.action == pytest.approx(exact["potential_energy"], rel=1e-12)
    assert path.v[:, 0] == pytest.approx(exact["c"], rel=1e-11)
    assert path.p[:, 2] == pytest.approx(exact["lam"], abs=1e-11)
    assert (
        np.abs(
            path.q[:, 1]
            - exact["lam"]
            - exact["c"] * np.cosh((path.q[:, 0] - exact["t0"]) / exact["c"])
        ).max()
        < 1e-11
    )


def test_geodesics_of_sphere_spheroid_and_torus_have_their_lengths():
    given, exact = reference("B03_geodesic_sphere")
    sphere = vi.models.great_circle().system
    ends = dict(q_start=[given["theta1"], given["phi1"]], q_end=[given["theta2"], given["phi2"]])
    path = vi.least_action(sphere, vi.gauss(4), duration=1.0, steps=80, **ends)
    assert path.action == pytest.approx(exact["action"], rel=1e-11)
    assert np.abs(path.at([0.25, 0.5, 0.75]).q - exact["theta_phi_points"]).max() < 1e-10

    given, exact = reference("B03_geodesic_psopt")
    a, b = given["a"], given["b"]
    places = []
    for xyz in (
        REFERENCE["B03_geodesic_psopt"]["initial"][key] for key in ("start_xyz", "end_xyz")
    ):
        places.append([np.arcsin(xyz[2] / b), np.arctan2(xyz[1], xyz[0])])
    path = vi.least_action(
        vi.models.spheroid_geodesic(a=a, b=b).system,
        vi.gauss(6),
        q_start=places[0],
        q_end=places[1],
        duration=1.0,
        steps=20,
    )
    assert np.sqrt(2 * path.action) == pytest.approx(exact["length_km"], rel=1e-12)

    given, exact = reference("B03_geodesic_torus_circulating")
    torus = vi.models.torus_geodesic().system
    path = vi.least_action(
        torus,
        vi.gauss(6),
        q_start=[0.0, 0.0],
        q_end=exact["state"][1][:2],
        duration=3.0,
        steps=30,
        guess=[[0, 0], exact["state"][0][:2], [1.6, 0.6], exact["state"][1][:2]],
    )
    assert path.action == pytest.approx(1.5, rel=1e-11)  # unit speed
    assert path.v[-1] == pytest.approx(exact["state"][1][2:], rel=1e-9)


# --- derivatives


def test_the_actions_derivatives_are_momenta_and_energy_of_the_oscillator():
    given, exact = reference("B01_action_harmonic")
    c = vi.Parameters(m=given["m"], w=given["w"])
    q, v = vi.coordinates("x")
    scene = vi.System(q, v, c.m / 2 * (v**2 - c.w**2 * q**2), params=c)
    x0, x1 = given["x0"], given["x1"]
    for k, row in enumerate(exact["rows"]):
        duration = row[0]
        path = vi.least_action(
            scene, vi.gauss(6), q_start=x0, q_end=x1, duration=duration, steps=30
        )
        change = vi.action_derivatives(path)
        assert change.action["q_start"] == pytest.approx(
            [exact["dS_dx0_equals_minus_p0"][k]], rel=1e-11
        )
        assert change.action["q_end"] == pytest.approx([exact["dS_dx1_equals_p1"][k]], rel=1e-11)
        assert change.action["duration"] == pytest.approx(
            exact["dS_dT_equals_minus_E"][k], rel=1e-11
        )
        assert change.action["m"] == pytest.approx(path.action / given["m"], rel=1e-12)
        angle, stiff = given["w"] * duration, given["m"] * given["w"]
        assert change.p_end["q_end"] == pytest.approx(stiff / np.tan(angle), rel=1e-10)
        assert change.p_start["q_end"] == pytest.approx(stiff / np.sin(angle), rel=1e-10)
        speed = (
            -given["w"] * (x1 - x0 * np.cos(angle)) * np.cos(angle) / np.sin(angle) ** 2
            + x0 * given["w"]
        )
        assert change.p_start["duration"] == pytest.approx(stiff * speed, rel=1e-10)


def test_derivatives_agree_with_differences_for_a_moving_scene_with_vector_parameters():
    c = vi.Parameters(g=9.81, l=np.array([1.0, 0.7]), A=np.array([[1.0, 0.2], [0.3, 0.5]]))
    q, v, t = *vi.coordinates("a", "b"), vi.time()
    kinetic = (
        c.A[0, 0] * v[0] ** 2 / 2
        + c.A[1, 1] * v[1] ** 2
        + c.A[0, 1] * v[0] * v[1] * ca.cos(q[0] - q[1])
    )
    lagrangian = (
        kinetic
        + c.g * (c.l[0] * ca.cos(q[0]) + c.l[1] * ca.cos(q[1])) * (1 + ca.sin(t) / 3)
        + c.A[1, 0] * q[0]
    )
    scene = vi.System(q, v, lagrangian, params=c, t=t)
    usual = dict(q_start=[0.1, 0.2], q_end=[0.5, -0.3], duration=0.7)

    def solve(name, index, size):
        values = dict(usual, params={})
        kind = values if name in usual else values["params"]
        moved = np.array(usual.get(name, scene.defaults.get(name)), dtype=float)
        moved[index] += size
        kind[name] = moved
        return vi.least_action(scene, vi.gauss(3), t0=0.3, steps=10, **values)

    change = vi.action_derivatives(vi.least_action(scene, vi.gauss(3), t0=0.3, steps=10, **usual))
    for name in (*usual, "g", "l", "A"):
        shape = np.shape(usual.get(name, scene.defaults.get(name)))
        assert change.action[name].shape == shape and change.p_end[name].shape == (2, *shape)
        for index in np.ndindex(*shape):
            ahead, back = (solve(name, index, size) for size in (1e-5, -1e-5))
            assert change.action[name][index] == pytest.approx(
                (ahead.action - back.action) / 2e-5, abs=1e-7
            )
            for node, found in ((0, change.p_start), (-1, change.p_end)):
                column = found[name][(slice(None), *index)]
                assert column == pytest.approx((ahead.p[node] - back.p[node]) / 2e-5, abs=1e-6)


def test_with_forces_end_momenta_have_derivatives_and_the_action_none():
    q, v = vi.coordinates("x")
    dragged = vi.System(q, v, v**2 / 2, force=-0.7 * v)
    path = vi.least_action(dragged, vi.gauss(4), q_start=0.0, q_end=1.0, duration=2.0, steps=20)
    change = vi.action_derivatives(path)
    assert change.action == {}
    assert change.p_start["q_end"] == pytest.approx(0.7 / (1 - np.exp(-1.4)), rel=1e-12)
    assert change.p_end["q_end"] == pytest.approx(0.7 / (np.exp(1.4) - 1), rel=1e-12)
