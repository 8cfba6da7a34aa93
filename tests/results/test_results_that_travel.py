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


def orbiting() -> vi.Trajectory:
    """Round a centre of attraction as its guess does, by steps of different sizes."""
    q, v = vi.coordinates("x", "y")
    kepler = vi.System(q, v, ca.sumsqr(v) / 2 + 1 / ca.norm_2(q))
    ends = dict(q_start=[1, 0], q_end=[-1, 0.1], guess=[[1, 0], [0, 1.2], [-1, 0.1]])
    return vi.least_action(kepler, duration=3.0, tol=1e-9, **ends)


def past_a_disc(radius: float) -> vi.Trajectory:
    """From (−1, 0.5) to (1, 0.5), which leans on the disc where its radius is above 0.5."""
    q, v = vi.coordinates("x", "y")
    scene = vi.System(q, v, ca.sumsqr(v) / 2 - ca.cos(q[0]) / 9)
    ends = dict(q_start=[-1, 0.5], q_end=[1, 0.5], duration=2.0, steps=10)
    bounds = [(radius**2, ca.sumsqr(q), None)]
    return vi.least_action(scene, vi.gauss(2), bounds=bounds, **ends)


def shortest() -> vi.Trajectory:
    """The brachistochrone, whose momenta hardly tell velocities."""
    model = vi.models.brachistochrone(1.0, 1.0, 9.81)
    s, deep = np.linspace(0, 1, 30)[:, None], np.sqrt(2.0)
    given = dict(guess=np.hstack([s, deep * np.sqrt(s)]), duration=vi.free(0.6, 0.01, 100.0))
    ends = dict(q_start=[0, 0], q_end=[1.0, deep], steps=10)
    return vi.least_action(model.system, vi.gauss(4), **ends, **given)


PATHS = {
    "round": orbiting,
    "leaning": lambda: past_a_disc(0.7),
    "clear": lambda: past_a_disc(0.3),
    "shortest": shortest,
}


@pytest.mark.parametrize("name", PATHS)
def test_the_action_of_a_path_stays_the_same_number_wherever_it_goes(name, copied, tmp_path):
    path = PATHS[name]()
    path.save(tmp_path / "a.npz")
    loaded = vi.load(tmp_path / "a.npz")
    loaded.save(tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    for there in (copied(path), loaded, copied(loaded), copied(copied(path))):
        assert there.action == path.action
    moving = vi.simulate(path.system, q0=path.q[0] + 0.1, v0=path.v[3], h=0.01, steps=4)
    assert "own_action" not in copied(moving).__dict__


@pytest.mark.parametrize("name", ["round", "leaning", "clear"])
def test_parts_of_a_path_that_has_travelled_have_actions_of_their_own(name, copied):
    path = PATHS[name]()
    for there in (path, copied(path)):
        halves = there[:5].action + there[4:].action
        assert halves == pytest.approx(path.action, rel=1e-12)
        assert abs(there[:5].action - path.action) > 0.1 * abs(path.action)
