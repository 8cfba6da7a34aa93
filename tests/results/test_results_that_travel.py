"""Fits, estimators, orbits and symmetries in other processes and in copies; solvers that stay."""

import copy
import pickle

import casadi as ca
import numpy as np
import pytest
from control_scenes import swing_up
from scenes import henon_heiles

import varint as vi

COPIES = {
    "pickle": lambda x: pickle.loads(pickle.dumps(x)),
    "old pickle": lambda x: pickle.loads(pickle.dumps(x, protocol=2)),
    "deepcopy": copy.deepcopy,
    "copy": copy.copy,
}


@pytest.fixture(params=COPIES)
def copied(request):
    return COPIES[request.param]


def same(one, other) -> bool:
    return np.asarray(one).tobytes() == np.asarray(other).tobytes()


def spring_fit(backend: str, jitter=0.0) -> vi.Fit:
    """Of a spring whose start depends on a parameter, from values with a gap."""
    q, v = vi.coordinates("x")
    c = vi.Parameters(k=1.0, a=0.9)
    spring = vi.System(q, v, v**2 / 2 - c.k * q**2 / 2, params=c)
    t = np.linspace(0, 3, 13)
    noise = 0.05 * np.random.default_rng(3).normal(size=13)
    values = np.column_stack([np.cos(2 * t) + noise, -2 * np.sin(2 * t) - noise])
    values[4, 0] = np.nan
    seen = vi.Measurement(ca.vertcat(q, v), t, values, sigma=[0.05, 0.1], jitter=jitter)
    given = dict(unknown=["k", "a"], h=0.1, q0=c.a, v0=0, backend=backend)
    return vi.fit(spring, vi.gauss(4), data=seen, **given)


@pytest.mark.parametrize("backend", ["interpreted", "compiled"])
def test_a_fit_travels_with_its_data_and_its_profiles(copied, backend):
    found = spring_fit(backend, jitter=vi.free(0.05, 0.0, 1.0))
    there = copied(found)
    assert there.names == found.names and there.summary == found.summary
    for name in ("estimates", "covariance", "step_shift", "sigma", "chi_squared"):
        assert same(getattr(there, name), getattr(found, name)), name
    assert same(there.residuals[0][0], found.residuals[0][0])
    assert same(there.trajectories[0].q, found.trajectories[0].q)
    one, other = there.data[0][0], found.data[0][0]
    assert str(one) == str(other) and one.jitter == other.jitter
    assert same(one.values, other.values) and same(one.sigma, other.sigma)
    motion = there.trajectories[0]
    assert same(motion.value(one.expression), motion.value(other.expression))
    assert there.profile("k").interval == found.profile("k").interval


def test_measurements_travel_and_fit_the_same_where_they_arrive(copied):
    found = spring_fit("interpreted")
    system, data = found.trajectories[0].system, found.data[0]
    given = dict(unknown=["k"], h=0.1, q0=1.0, v0=0, backend="interpreted")
    plain = vi.fit(system, vi.gauss(4), data=data, **given)
    again = vi.fit(copied(system), vi.gauss(4), data=[copied(data[0])], **given)
    assert same(again.estimates, plain.estimates) and same(again.covariance, plain.covariance)


def test_symmetries_and_what_they_conserve_travel(copied):
    q, v = vi.coordinates("x", "y")
    c = vi.Parameters(k=1.0)
    scene = vi.System(q, v, ca.sumsqr(v) / 2 - c.k * ca.sumsqr(q) ** 2 / 4, params=c)
    motion = vi.simulate(scene, q0=[1, 0], v0=[0, 0.5], h=0.05, steps=40)
    table, maps = vi.symmetries(scene), motion.conserved()
    assert str(copied(table)) == str(table)
    for one, other in zip(copied(table), table, strict=True):
        assert str(one) == str(other) and one.formula == other.formula
        assert same(motion.value(one.quantity), motion.value(other.quantity))
        moved, its = pickle.loads(pickle.dumps((motion, other)))
        assert moved.system is its.system
        assert same(moved.momentum_map(its).values, motion.momentum_map(other).values)
    there = copied(maps)
    assert str(there) == str(maps)
    assert same(there[0].values, maps[0].values)


def test_an_estimator_travels_and_goes_on_where_it_was(copied):
    q, v = vi.coordinates("theta")
    pendulum = vi.System(q, v, v**2 / 2 + 9.81 * ca.cos(q))
    given = dict(h=0.05, horizon=6, measured=q, sigma=0.01, q0=0.0, v0=0.0)
    look = vi.mhe(pendulum, **given)
    true = vi.simulate(pendulum, q0=1.0, v0=0.5, h=0.05, steps=12).q[:, 0]
    estimate = None
    for angle in true[:8]:
        estimate = look(angle, previous=estimate)
    there, known = copied((look, estimate))
    for angle in true[8:]:
        estimate, known = look(angle, previous=estimate), there(angle, previous=known)
    assert same(known.q, estimate.q) and same(known.covariance, estimate.covariance)


def test_orbits_travel(copied):
    orbit = vi.orbits.periodic(henon_heiles(), ([0, 0.1], [0.3, 0]), period=6.2)
    there = copied(orbit)
    assert repr(there) == repr(orbit)
    assert same(there.motion.energy, orbit.motion.energy)


def test_phases_of_an_optimal_control_travel_as_motions(copied):
    motion = swing_up(steps=12)
    [there] = copied([motion])
    assert there.solution.cost == motion.solution.cost


def test_solvers_that_are_built_stay_where_they_are_and_say_so():
    q, v = vi.coordinates("x")
    u = ca.SX.sym("u")
    cart = vi.System(q, v, v**2 / 2, force=u, control=u)
    ahead = vi.Phase(cart, vi.gauss(1), 1.0, 6, u**2)
    whole = vi.Phase(cart, vi.gauss(1), 1.0, 6, u**2, start=dict(q=0, v=0), end=dict(q=1, v=0))
    for made, what in ((vi.mpc(ahead), "a controller"), (vi.prepare(whole), "a prepared problem")):
        with pytest.raises(vi.InputError, match=f"{what} holds a solver.*build it anew"):
            pickle.dumps(made)
        assert copy.copy(made) is made and copy.deepcopy(made) is made
