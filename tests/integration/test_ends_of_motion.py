"""Motions that end before their duration does are told of at once, with what was reached; near
misses are followed through.
"""

import casadi as ca
import numpy as np
import pytest

import varint as vi


def kepler() -> vi.System:
    q, v = vi.coordinates("x", "y")
    return vi.System(q, v, ca.sumsqr(v) / 2 + 1 / ca.norm_2(q))


def test_a_fall_into_the_centre_ends_when_it_gets_there():
    """From rest at distance 1 it takes π/√8."""
    with pytest.raises(
        vi.ConvergenceError, match=r"the motion ends at t = 1\.1107.*collide"
    ) as told:
        vi.simulate(kepler(), q0=[1.0, 0.0], v0=[0.0, 0.0], duration=5.0)
    reached = told.value.trajectory
    assert reached.t[-1] == told.value.time == pytest.approx(np.pi / 8**0.5, abs=1e-6)
    x = reached.q[:, 0]
    before = (x * np.abs(reached.energy + 1))[x > 1e-3]  # beside the potential 1/x
    assert len(before) > 100 and before.max() < 1e-11


def test_a_run_that_leaps_over_the_end_hides_it_from_no_other():
    """A dumbbell falls into the centre; the sixth of the runs that follow it gets behind that."""
    q, v = vi.coordinates("r", "phi", "alpha")
    r, alpha, e = q[0], q[2], 0.01
    kinetic = (v[0] ** 2 + r**2 * v[1] ** 2 + e * (v[1] + v[2]) ** 2) / 2
    scene = vi.System(q, v, kinetic + 1 / r + 3 * e / (4 * r**3) * ca.cos(2 * alpha))
    start = {
        "q0": [0.4094005441903701, 0.0, 0.44768294812328535],
        "v0": [0.06983838435352945, 0.7407745241736566, 0.0],
    }
    with pytest.raises(vi.ConvergenceError, match=r"ends at t = 0\.281129: .* to \d{5,6} steps"):
        vi.simulate(scene, **start, duration=22.44901965086632, tol=7.07701152460853e-05)


@pytest.mark.parametrize("friction", [0.1, 0.13])
def test_dry_friction_that_holds_a_body_is_named_where_steps_do_not_end_at_its_switch(friction):
    """Not in interpreted runs, here beside a contact that is never met."""
    q, v = vi.coordinates("x")
    force = -friction * ca.sign(v)
    scene = vi.System(q, v, v**2 / 2 - q**2 / 2, force=force, contact=q + 100)
    with pytest.raises(vi.ConvergenceError, match=r"force of the scene jumps.*tanh") as told:
        vi.simulate(scene, q0=1.0, v0=0.0, duration=20.0, backend="interpreted")
    reached = told.value.trajectory
    assert reached.t[-1] == told.value.time > np.pi and np.isfinite(reached.q).all()


@pytest.mark.parametrize("e", [0.9999, 1 - 1e-8])
@pytest.mark.parametrize("turns", [0.7, 1.0])
def test_a_near_miss_is_followed_through_by_few_steps(e, turns):
    """Half an orbit before and after pericentre; Kepler's equation has the place."""
    motion = vi.simulate(
        kepler(), q0=[1 + e, 0.0], v0=[0.0, ((1 - e) / (1 + e)) ** 0.5], duration=turns * 2 * np.pi
    )
    mean = (turns + 0.5) * 2 * np.pi
    anomaly = mean
    for _ in range(60):
        anomaly -= (anomaly - e * np.sin(anomaly) - mean) / max(1 - e * np.cos(anomaly), 0.1)
    exact = [e - np.cos(anomaly), -((1 - e**2) ** 0.5) * np.sin(anomaly)]
    assert np.abs(motion.q[-1] - exact).max() < 1e-9
    assert motion.stats["error_estimate"] <= 1e-9 and len(motion) < 10_000


def test_a_pole_of_the_coordinates_is_not_taken_for_a_body_without_mass():
    q, v = vi.coordinates("theta", "phi")
    scene = vi.System(q, v, (v[0] ** 2 + ca.sin(q[0]) ** 2 * v[1] ** 2) / 2 + ca.cos(q[0]))
    with pytest.raises(
        vi.InputError, match=r"mass of \['phi'\].*singular there, as spherical ones"
    ):
        vi.simulate(scene, q0=[0.0, 0.0], v0=[1.0, 0.0], duration=1.0)


@pytest.mark.parametrize("duration", [1.5, 5.0, 40.0])
@pytest.mark.parametrize("more", [(), ("y",)])
def test_a_mass_that_vanishes_on_the_way_ends_the_motion(duration, more):
    """x v²/2 + x = 1 leads to x = 0 in π/√8; steps leap over that, or turn back before it, and
    nothing that comes behind is a motion. It took up to 69 s, and came back with warnings.
    """
    q, v = vi.coordinates("x", *more)
    scene = vi.System(q, v, q[0] * v[0] ** 2 / 2 - q[0] + ca.sumsqr(v[1:]) / 2)
    start = dict(q0=np.ones(len(more) + 1), v0=np.zeros(len(more) + 1))
    with pytest.raises(vi.ConvergenceError, match="no run of up to") as told:
        vi.simulate(scene, **start, duration=duration)
    error = told.value
    assert error.time == pytest.approx(np.pi / np.sqrt(8), rel=1e-4)
    assert len(error.trajectory) < 2**18 and 0 < error.trajectory.q[-1, 0] < 0.1
    before = vi.simulate(scene, **start, duration=1.0).q[-1, 0]  # x' = −√(2 (1 − x)/x)
    assert np.sqrt(before * (1 - before)) + np.arccos(np.sqrt(before)) == pytest.approx(np.sqrt(2))


def puck(friction):
    """On a plane, thrown at √5 with μ g = 3: it comes to rest after √5/3, at 5/6 of its way."""
    q, v = vi.coordinates("x", "y")
    scene = vi.System(q, v, ca.sumsqr(v) / 2, force=-3 * friction(v))
    return scene, {"q0": [0.0, 0.0], "v0": [2.0, 1.0], "duration": 2.0}


def test_friction_that_is_not_defined_at_rest_is_named_where_it_stops_a_body():
    scene, start = puck(lambda v: v / ca.norm_2(v))
    with pytest.raises(
        vi.ConvergenceError, match=r"divides by the speed of x, y.*sqrt\(v·v \+ s²\)"
    ) as told:
        vi.simulate(scene, **start)
    reached = told.value.trajectory
    assert told.value.time == pytest.approx(5**0.5 / 3, abs=2e-3)  # a step
    assert np.abs(reached.q[-1] - np.array([2, 1]) * 5**0.5 / 6).max() < 1e-5
    moving = vi.simulate(scene, **start | {"duration": 0.7})
    way = 0.7 * 5**0.5 - 3 * 0.7**2 / 2
    assert np.abs(moving.q[-1] - np.array([2, 1]) / 5**0.5 * way).max() < 1e-9


def test_friction_that_is_hardly_rounded_is_followed_to_rest_and_beyond():
    """Within a speed of 1e-5 it turns over: at a rate of 3e5, three million equal steps of a unit,
    or some fifty that are fitted, the long ones of which damp what is left of the speed slowly.
    """
    q, v = vi.coordinates("x")
    scene = vi.System(q, v, v**2 / 2, force=-3 * v / ca.sqrt(v**2 + 1e-11))
    motion = vi.simulate(scene, q0=0.0, v0=2.0, duration=1.0)
    assert motion.q[-1, 0] == pytest.approx(2 / 3, abs=1e-9) and abs(motion.v[-1, 0]) < 1e-11
    steep = vi.System(q, v, v**2 / 2, force=-3 * ca.tanh(v / 1e-9))
    with pytest.raises(vi.ConvergenceError, match=r"turns over within a tiny speed of x.*e\+09"):
        vi.simulate(steep, q0=0.0, v0=2.0, duration=1.0)
