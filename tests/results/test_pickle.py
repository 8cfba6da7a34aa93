"""Systems, motions, ensembles and errors in other processes and in copies, with all they hold."""

from __future__ import annotations

import copy
import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor
from dataclasses import fields

import casadi as ca
import numpy as np
import pytest
from control_scenes import swing_up
from scenes import cartesian_pendulum, double_pendulum, henon_heiles, rocking

import varint as vi
from varint.boundary.minimise import ActiveBounds
from varint.scene.serialisation import describe

COPIES = {
    "pickle": lambda x: pickle.loads(pickle.dumps(x)),
    "old pickle": lambda x: pickle.loads(pickle.dumps(x, protocol=2)),
    "deepcopy": copy.deepcopy,
    "copy": copy.copy,
}
ARRAYS = ("t", "q", "p", "v", "k", "u", "c", "energy")


@pytest.fixture(params=COPIES)
def copied(request):
    return COPIES[request.param]


def plain() -> vi.Trajectory:
    return vi.simulate(henon_heiles(), q0=[0.1, 0.2], v0=[0, 0.1], h=0.1, steps=30)


def with_parameters() -> vi.Trajectory:
    q, v = vi.coordinates("x")
    c = vi.Parameters(a=2.0, b=np.arange(6.0).reshape(2, 3))
    system = vi.System(q, v, v**2 / 2 - c.a * ca.cos(q) - c.b[1, 2] * q**2, params=c)
    return vi.simulate(system, vi.gauss(2), q0=1, v0=0, h=0.1, steps=30, params=dict(a=1.5))


def constrained() -> vi.Trajectory:
    return vi.simulate(cartesian_pendulum(), q0=[1, 0], v0=[0, 0], h=0.02, steps=30)


def with_contacts() -> vi.Trajectory:
    return vi.simulate(rocking(), q0=[1.0, 0.5, 1.2], v0=[1.5, 0, 0], h=0.01, steps=120)


def with_a_time_scale() -> vi.Trajectory:
    q, v = vi.coordinates("x", "y")
    kepler = vi.System(q, v, ca.sumsqr(v) / 2 + 1 / ca.norm_2(q))
    start = dict(q0=[1, 0], v0=[0, 0.8], h=0.05, steps=30)
    return vi.simulate(kepler, time_scale=ca.norm_2(q) ** 1.5, **start)


def path() -> vi.Trajectory:
    q, v = vi.coordinates("x", "y")
    ball = vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[1])
    start = dict(q_start=[0, 0], q_end=[10, 0], duration=2.0, steps=20)
    return vi.least_action(ball, vi.gauss(2), **start)


def bounded_path() -> vi.Trajectory:
    q, v = vi.coordinates("x", "y")
    ball = vi.System(q, v, ca.sumsqr(v) / 2)
    start = dict(q_start=[-1, 0], q_end=[1, 0.0], duration=2.0, steps=10)
    guess = np.column_stack([np.linspace(-1, 1, 11), np.full(11, 0.6)])
    return vi.least_action(
        ball, vi.gauss(2), **start, guess=guess, bounds=[(0.25, ca.sumsqr(q), np.inf)]
    )


def optimal() -> vi.Trajectory:
    return swing_up(steps=12)


MOTIONS = [
    plain,
    with_parameters,
    constrained,
    with_contacts,
    with_a_time_scale,
    path,
    bounded_path,
    optimal,
]


def assert_same(one: vi.Trajectory, other: vi.Trajectory) -> None:
    for name in ARRAYS:
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name
    assert describe(one.system) == describe(other.system)
    assert (one.rule, one.h, one.origin, one.events) == (
        other.rule,
        other.h,
        other.origin,
        other.events,
    )
    assert one.active_sets == other.active_sets
    # a process may have the compiled loop already, which makes the same bytes
    differs = dict(seconds="", backend="")
    stats = [{k: str(v) for k, v in motion.stats.items()} | differs for motion in (one, other)]
    assert stats[0] == stats[1]
    middle = (one.t[2] + one.t[3]) / 2
    if one.fictitious is not None or one.system.structure.contacts == 0:
        assert one.at(middle).q.tobytes() == other.at(middle).q.tobytes()


@pytest.mark.parametrize("make", MOTIONS)
def test_a_motion_that_travels_is_the_same_motion(make, copied):
    motion = make()
    there = copied(motion)
    assert_same(there, motion)
    assert (there.fictitious is None) == (motion.fictitious is None)
    assert type(there.solution) is type(motion.solution)
    with pytest.raises(TypeError):  # the copy is as frozen as its model
        there.stats["plan"] = None
    with pytest.raises(AttributeError):
        there.h = 1.0


@pytest.mark.parametrize("make", MOTIONS)
def test_a_motion_that_travels_is_the_one_that_a_file_keeps(make, tmp_path):
    motion = make()
    motion.save(tmp_path / "a.npz")
    loaded = vi.load(tmp_path / "a.npz")
    assert_same(loaded, motion)
    assert type(loaded.solution) is type(motion.solution)


def test_plans_travel_whole(copied):
    motion = plain()
    there = copied(motion).stats["plan"]
    assert str(there) == str(motion.stats["plan"])
    stepper = there.build(motion.system, motion.rule)
    assert type(stepper) is type(motion.stats["plan"].build(motion.system, motion.rule))


def test_an_optimal_control_travels_with_its_solution(copied, capsys):
    motion = optimal()
    there = copied(motion)
    one, other = motion.solution, there.solution
    assert (one.cost, one.status, one.iterations) == (other.cost, other.status, other.iterations)
    assert one.costates.q.tobytes() == other.costates.q.tobytes()
    assert list(one.active) == list(other.active)
    assert dict(one.history) == dict(other.history) and dict(one.timings) == dict(other.timings)
    t = motion.t[-1] / 3
    assert there.u_at(t).tobytes() == motion.u_at(t).tobytes()
    assert there.replay().q.tobytes() == motion.replay().q.tobytes()
    there.report()
    assert one.status in capsys.readouterr().out


def test_active_bounds_travel_and_are_kept_by_files(copied, tmp_path):
    motion = bounded_path()
    motion.save(tmp_path / "a.npz")
    for there in (copied(motion), vi.load(tmp_path / "a.npz")):
        assert isinstance(there.solution, ActiveBounds) and there.solution.touches.any()
        for f in fields(ActiveBounds):
            one, other = getattr(there.solution, f.name), getattr(motion.solution, f.name)
            assert np.array_equal(one, other), f.name


def test_motions_of_one_system_still_share_it_where_they_arrive():
    system = double_pendulum()
    start = dict(v0=[0, 0], h=0.05, steps=10)
    two = [vi.simulate(system, q0=[a, 0.1], **start) for a in (0.1, 0.2)]
    one, other = pickle.loads(pickle.dumps(two))
    assert one.system is other.system
    assert one.system is not system
    assert copy.deepcopy(two)[0].system is system


def test_expressions_of_a_system_stay_its_own_in_deep_copies():
    motion = with_parameters()
    kept = dict(motion=motion, speed=motion.system.v, system=motion.system)
    there = copy.deepcopy(kept)
    assert there["system"] is motion.system
    assert (
        there["motion"].value(there["speed"] ** 2).tobytes()
        == motion.value(motion.system.v**2).tobytes()
    )
    assert not np.shares_memory(there["motion"].q, motion.q)


def test_a_pickle_is_small_and_leaves_out_what_follows_from_the_rest():
    motion = plain()
    before = pickle.dumps(motion)
    _ = motion.v, motion.energy, motion.action, motion.multipliers
    assert pickle.dumps(motion) == before
    assert len(pickle.dumps(motion.system)) < 2000


@pytest.mark.parametrize("stored", [False, True])
def test_an_ensemble_travels(copied, stored, tmp_path):
    q0 = np.linspace(0, 0.4, 12).reshape(6, 2)
    store = tmp_path / "kept" if stored else None
    motions = vi.ensemble(henon_heiles(), q0=q0, v0=[0, 0], h=0.1, steps=10, store=store)
    there = copied(motions)
    assert there.q.tobytes() == motions.q.tobytes() and there.v.tobytes() == motions.v.tobytes()
    assert there[3].energy.tobytes() == motions[3].energy.tobytes()
    motion = copied(motions[2])
    assert motion.at(0.55).q.tobytes() == motions[2].at(0.55).q.tobytes()


def failed_run() -> vi.ConvergenceError:
    q, v = vi.coordinates("x")
    falling = vi.System(q, v, v**2 / 2 + ca.sqrt(q))
    with pytest.raises(vi.ConvergenceError) as caught:
        vi.simulate(falling, vi.gauss(2), q0=1.0, v0=-3.0, h=0.1, steps=50)
    return caught.value


def test_an_error_travels_with_its_motion(copied):
    error = failed_run()
    error.more = "seen in member 3"
    there = copied(error)
    assert type(there) is vi.ConvergenceError and str(there) == str(error)
    for name in ("step", "time", "cause", "more"):
        assert getattr(there, name) == getattr(error, name), name
    assert np.array_equal(there.residual, error.residual, equal_nan=True)
    assert_same(there.trajectory, error.trajectory)


def test_a_solver_error_travels_with_its_iterate(copied):
    iterate = optimal()
    there = copied(vi.SolverError("no", status="Infeasible", iterate=iterate))
    assert there.status == "Infeasible" and str(there) == "no"
    assert_same(there.iterate, iterate)


def test_other_errors_travel_too(copied):
    from varint.codegen.cache import CompileError
    from varint.codegen.graph import NotCompilable
    from varint.errors import StepRefused

    for kind in (vi.VarintError, vi.InputError, StepRefused, CompileError, NotCompilable):
        there = copied(kind("words"))
        assert type(there) is kind and there.args == ("words",)


def swing(system: vi.System, amplitude: float) -> vi.Trajectory:
    """Work for another process."""
    return vi.simulate(system, vi.gauss(2), q0=[amplitude, 0], v0=[0, 0], h=0.02, steps=50)


def fail(system: vi.System) -> vi.Trajectory:
    return vi.simulate(system, vi.gauss(2), q0=1.0, v0=-3.0, h=0.1, steps=50)


def energy_of(motion: vi.Trajectory) -> np.ndarray:
    return motion.energy


def test_a_pool_of_processes_takes_systems_and_returns_motions_and_errors():
    system = double_pendulum()
    amplitudes = [0.1, 0.2, 0.3, 0.4]
    here = [swing(system, a) for a in amplitudes]
    q, v = vi.coordinates("x")
    falling = vi.System(q, v, v**2 / 2 + ca.sqrt(q))
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:
        there = list(pool.map(swing, [system] * 4, amplitudes))
        for one, other in zip(there, here, strict=True):
            assert_same(one, other)
        energies = list(pool.map(energy_of, here))
        assert [e.tobytes() for e in energies] == [m.energy.tobytes() for m in here]
        with pytest.raises(vi.ConvergenceError) as caught:
            pool.submit(fail, falling).result()
    assert caught.value.trajectory.q.tobytes() == failed_run().trajectory.q.tobytes()
