"""Morse index and conjugate times: closed forms, multiplicities, every kind of rule,
constraints.
"""

import casadi as ca
import numpy as np
import pytest
from references import entries
from scenes import double_pendulum, driven_damped, pendulum

import varint as vi

REFERENCE = entries("b")
RULES = [
    vi.gauss(1),
    vi.gauss(4),
    vi.gauss(9),
    vi.lobatto(2),
    vi.lobatto(5),
    vi.composition("verlet"),
    vi.composition("yoshida4"),
    vi.composition("blanes-moan4"),
    vi.composition("kahan-li8"),
]


def oscillator(dimensions=1):
    q, v = vi.coordinates(*"xyz"[:dimensions])
    return vi.System(q, v, (ca.sumsqr(v) - ca.sumsqr(q)) / 2)


# the index is right on steps too few for the path itself
COARSE = pytest.mark.filterwarnings("ignore:.*too few for this path")


@COARSE
@pytest.mark.parametrize("rule", RULES, ids=repr)
@pytest.mark.parametrize(("duration", "index"), [(1.0, 0), (3.0, 0), (4.0, 1), (7.0, 2), (20.0, 6)])
def test_the_oscillators_index_is_the_number_of_half_periods(rule, duration, index):
    path = vi.least_action(
        oscillator(), rule, q_start=0.4, q_end=-0.9, duration=duration, steps=120
    )
    assert path.morse_index == index == len(path.conjugate_times)
    assert path.is_minimum == (index == 0)


def test_conjugate_times_of_the_oscillator_are_its_half_periods():
    path = vi.least_action(
        oscillator(), vi.gauss(4), q_start=0.4, q_end=-0.9, duration=20.0, steps=120
    )
    assert np.abs(path.conjugate_times - np.pi * np.arange(1, 7)).max() < 1e-10


@pytest.mark.parametrize("steps", [8, 16, 64])
def test_a_node_that_is_itself_conjugate_counts_once(steps):
    motion = vi.simulate(
        oscillator(2),
        vi.gauss(8),
        q0=[1, 0],
        v0=[0, 1],
        duration=4 * np.pi + 0.5 * np.pi,
        steps=9 * steps,
    )
    assert motion.morse_index == 8
    assert np.abs(motion.conjugate_times - np.pi * np.repeat([1, 2, 3, 4], 2)).max() < 1e-7


def test_steps_longer_than_the_conjugate_time_still_count():
    path = vi.least_action(
        oscillator(), vi.gauss(10), q_start=0.4, q_end=-0.9, duration=20.0, steps=4
    )
    assert path.morse_index == 6
    assert np.abs(path.conjugate_times - np.pi * np.arange(1, 7)).max() < 1e-6


@pytest.mark.parametrize("row", range(3))
def test_the_pendulums_kinetic_focus_is_where_the_jacobi_field_vanishes(row):
    speed, time, _ = REFERENCE["B01_pendulum_conjugate_point"]["reference"]["rows"][row]
    motion = vi.simulate(pendulum(), vi.gauss(6), q0=0.0, v0=speed, h=0.1, steps=80)
    assert motion.conjugate_times[0] == pytest.approx(time, rel=1e-11)


@pytest.mark.parametrize("row", range(3))
def test_kepler_orbits_are_conjugate_to_the_pericentre_after_one_period(row):
    e, time = REFERENCE["B01_kepler_conjugate_times"]["reference"]["rows"][row]
    q, v = vi.coordinates("x", "y")
    scene = vi.System(q, v, ca.sumsqr(v) / 2 + 1 / ca.norm_2(q))
    start = dict(q0=[1 - e, 0], v0=[0, np.sqrt((1 + e) / (1 - e))])
    orbit = vi.simulate(scene, vi.gauss(8), duration=6.5, steps=130, **start)
    assert orbit.conjugate_times == pytest.approx([time], rel=1e-9)
    assert vi.simulate(scene, vi.gauss(8), duration=6.2, steps=124, **start).is_minimum


def test_out_of_its_plane_a_circular_orbit_is_conjugate_after_half_a_turn():
    q, v = vi.coordinates("x", "y", "z")
    scene = vi.System(q, v, ca.sumsqr(v) / 2 + 1 / ca.norm_2(q))
    orbit = vi.simulate(scene, vi.gauss(8), q0=[1, 0, 0], v0=[0, 1, 0], duration=6.5, steps=80)
    assert orbit.conjugate_times == pytest.approx([np.pi, 2 * np.pi, 2 * np.pi], rel=1e-9)


def test_conjugate_times_converge_with_the_order_of_the_rule():
    exact = REFERENCE["B01_pendulum_conjugate_point"]["reference"]["rows"][1][1]
    for rule in (vi.gauss(1), vi.gauss(2), vi.lobatto(3), vi.composition("yoshida4")):
        errors = [
            abs(
                vi.simulate(
                    pendulum(), rule, q0=0.0, v0=1.0, duration=4.0, steps=n
                ).conjugate_times[0]
                - exact
            )
            for n in (33, 65, 129)
        ]
        observed = np.log(errors[0] / errors[2]) / np.log(129 / 33)
        assert abs(observed - rule.order) < 0.2, (rule, observed)


@COARSE
def test_the_index_is_that_of_the_second_derivatives_of_the_whole_action():
    scene, rule, steps = double_pendulum(), vi.gauss(2), 12
    path = vi.least_action(
        scene, rule, q_start=[0.1, 0.0], q_end=[0.4, -0.5], duration=2.5, steps=steps
    )
    from varint.discrete.lagrangian import interval

    one = interval(scene, rule)
    local = ca.Function("L", [one.q0, one.dq, one.t, one.h], [one.action])
    points = ca.SX.sym("Q", 2, 2 * steps + 1)
    total = 0
    for k in range(steps):
        start = points[:, 2 * k]
        total += local(
            start, points[:, 2 * k + 1 : 2 * k + 3] - ca.repmat(start, 1, 2), k * path.h, path.h
        )
    inner = ca.vec(points[:, 1:-1])
    found = np.empty((2, 2 * steps + 1))
    found[:, ::2] = path.q.T
    # near the inner control points: enough to count signs
    middle = path.at(path.t[:-1] + path.h / 2).q.T
    found[:, 1::2] = middle
    hessian = ca.Function("H", [points], [ca.hessian(total, inner)[0]])
    values = np.linalg.eigvalsh(np.array(ca.densify(hessian(found))))
    assert path.morse_index == (values < 0).sum() > 0


def test_holonomic_constraints_restrict_the_variations():
    q, v = vi.coordinates("x", "y")
    rod = vi.System(q, v, ca.sumsqr(v) / 2 - q[1], constraint=ca.sumsqr(q) - 1)
    free = vi.simulate(pendulum(), vi.gauss(6), q0=0.0, v0=1.0, h=0.05, steps=180)
    held = vi.simulate(rod, vi.lobatto(6), q0=[0.0, -1.0], v0=[1.0, 0.0], h=0.05, steps=180)
    assert held.morse_index == free.morse_index == 2
    assert np.abs(held.conjugate_times - free.conjugate_times).max() < 1e-9


def bowl(stretch=1.0, centre=0.0, g=9.81):
    """A bead on the ellipsoid (x − centre)² + a y² + z² = 1."""
    q, v = vi.coordinates("x", "y", "z")
    surface = (q[0] - centre) ** 2 + stretch * q[1] ** 2 + q[2] ** 2 - 1
    return vi.System(q, v, ca.sumsqr(v) / 2 - g * q[2], constraint=surface)


@pytest.mark.parametrize("centre", [0.0, 1e6])
@pytest.mark.parametrize("speed", [1e-3, 1e-6, 1e-9, 1e-12, 0.0])
def test_slow_motions_and_short_steps_are_no_reason_to_refuse(speed, centre):
    """Small oscillations at the bottom, to round-off of the place where they are."""
    run = dict(q0=[centre, 0, -1], v0=[speed, 0, 0], backend="interpreted")
    motion = vi.simulate(bowl(centre=centre), vi.lobatto(3), **run, h=0.004, steps=300)
    half = np.pi / np.sqrt(9.81)
    assert motion.conjugate_times == pytest.approx([half, half], rel=3e-6)


@pytest.mark.parametrize("rule", [vi.gauss(2), vi.lobatto(3), vi.composition("yoshida4")], ids=repr)
def test_a_motion_backwards_in_time_has_the_conjugate_times_of_its_mirror(rule):
    run = dict(q0=1.0, steps=120)
    ahead = vi.simulate(pendulum(), rule, v0=0.4, h=0.05, **run)
    back = vi.simulate(pendulum(), rule, v0=-0.4, h=-0.05, **run)
    assert len(ahead.conjugate_times) == ahead.morse_index == back.morse_index > 0
    np.testing.assert_allclose(back.conjugate_times, -ahead.conjugate_times, rtol=0, atol=1e-11)


@pytest.mark.parametrize("kind", ["bowl", "rods", "bead"])
def test_no_start_on_constraints_is_refused(kind):
    rng = np.random.default_rng(3)
    q, v = vi.coordinates(*"abcd")
    chain = ca.vertcat(ca.sumsqr(q[:2]) - 1, ca.sumsqr(q[2:] - q[:2]) - 1)
    rods = vi.System(q, v, ca.sumsqr(v) / 2 - q[1] - q[3], constraint=chain)
    x, w = vi.coordinates("x", "y")
    bead = vi.System(x, w, ca.sumsqr(w) / 2 - x[1], constraint=x[1] - x[0] ** 2)
    for i in range(4):
        system = {"bowl": bowl(10 ** rng.uniform(-1, 1), g=i), "rods": rods, "bead": bead}[kind]
        n = system.structure.n
        q0, v0 = vi.project(system, rng.normal(size=n), rng.normal(size=n))
        run = dict(q0=q0, v0=v0, steps=60, backend="interpreted")
        motion = vi.simulate(system, vi.lobatto(3), h=0.04, **run)
        times = motion.conjugate_times
        assert len(times) == motion.morse_index
        assert ((times > 0) & (times <= motion.duration)).all() and (np.diff(times) >= 0).all()


def test_what_has_no_index_says_so():
    with pytest.raises(vi.InputError, match="forces"):
        vi.simulate(driven_damped(), vi.gauss(2), q0=[0, 0], v0=[1, 1], h=0.1, steps=3).morse_index  # noqa: B018
    motion = vi.simulate(pendulum(), vi.gauss(2), q0=0.0, v0=1.0, h=0.1, steps=20, save_every=2)
    with pytest.raises(vi.InputError, match="every step"):
        motion.conjugate_times  # noqa: B018
    q, v = vi.coordinates("x", "y")
    twice = vi.System(
        q, v, ca.sumsqr(v) / 2, constraint=ca.vertcat(ca.sumsqr(q) - 1, 2 * ca.sumsqr(q) - 2)
    )
    with pytest.warns(UserWarning):
        turning = vi.simulate(twice, vi.lobatto(3), q0=[1, 0], v0=[0, 1], h=0.1, steps=3)
    with pytest.raises(vi.InputError, match="redundant"):
        turning.morse_index  # noqa: B018
    saddle = vi.System(q, v, (v[0] ** 2 - v[1] ** 2) / 2)
    with pytest.raises(vi.InputError, match="infinitely many"):
        vi.simulate(saddle, vi.gauss(1), q0=[0, 0], v0=[1, 1], h=0.1, steps=3).morse_index  # noqa: B018
