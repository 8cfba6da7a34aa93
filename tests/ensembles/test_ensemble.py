"""Ensembles: bit for bit the loop of simulate, whatever the chunks; failures apart; shapes and
refusals.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scenes import double_pendulum, driven_damped, henon_heiles

import varint as vi
from varint.ensembles import batch
from varint.ensembles import executor as executor_module
from varint.ensembles.executor import _cut


def swinging() -> vi.System:
    c = vi.Parameters(length=1.0, g=9.81)
    q, v = vi.coordinates("theta")
    return vi.System(q, v, c.length**2 * v**2 / 2 + c.g * c.length * ca.cos(q), params=c)


def assert_members_are(
    motions: vi.Ensemble, system: vi.System, rule, starts: list[dict], members=None, **grid
) -> None:
    """Each member is bit for bit what `simulate` makes of its start."""
    for i in range(len(starts)) if members is None else members:
        one = vi.simulate(system, rule, backend="interpreted", **starts[i], **grid)
        assert (
            motions.q[i].tobytes() == one.q.tobytes() and motions.p[i].tobytes() == one.p.tobytes()
        ), f"member {i}"
        np.testing.assert_array_equal(motions.t, one.t)


def test_ten_thousand_pendulums_are_the_loop_of_simulate_bit_for_bit():
    system, count = swinging(), 10_000
    angles, lengths = np.linspace(-3, 3, count), np.linspace(0.5, 2, count)
    grid = dict(h=0.02, steps=60, save_every=7)
    motions = vi.ensemble(
        system, q0=angles, v0=0.1, params=dict(length=lengths), backend="interpreted", **grid
    )
    assert motions.q.shape == (count, 10, 1) and len(motions) == count
    starts = [
        dict(q0=a, v0=0.1, params=dict(length=x)) for a, x in zip(angles, lengths, strict=True)
    ]
    assert_members_are(motions, system, None, starts, range(0, count, 97), **grid)


LANES = [
    None,
    vi.composition("verlet"),
    vi.composition("kahan-li8"),
    vi.gauss(1),
    vi.gauss(2),
    vi.gauss(5),
]


@pytest.mark.parametrize("rule", LANES, ids=str)
def test_compiled_members_are_the_interpreted_ones_to_round_off_in_any_chunks(rule, monkeypatch):
    system, count = swinging(), 1003 if rule is None or rule.kicks else 131
    start = dict(
        q0=np.linspace(-3, 3, count),
        v0=np.linspace(0, 1, count),
        h=0.02,
        steps=301,
        save_every=4,
        t0=0.3,
    )
    start["params"] = dict(length=np.linspace(0.5, 2, count))
    plain = vi.ensemble(system, rule, backend="interpreted", **start)
    lanes = vi.ensemble(system, rule, backend="compiled", **start)
    np.testing.assert_allclose(lanes.q, plain.q, atol=1e-11)
    np.testing.assert_allclose(lanes.p, plain.p, atol=1e-11)
    np.testing.assert_array_equal(lanes.t, plain.t)
    monkeypatch.setattr(executor_module, "SECONDS", 1e-9)
    again = vi.ensemble(system, rule, backend="compiled", **start)
    assert (
        len(again.chunks) > 10
        and again.q.tobytes() == lanes.q.tobytes()
        and again.p.tobytes() == lanes.p.tobytes()
    )


@pytest.mark.parametrize("rule", [vi.composition("verlet"), vi.gauss(2)], ids=str)
def test_compiled_members_that_fail_do_not_take_their_neighbours_along(rule):
    """Sixteen members in two vectors; the force is not defined below zero, where three of them
    go.
    """
    v0 = np.linspace(-2.4, 2.0, 16)
    start = dict(q0=1.0, v0=v0, h=0.01, steps=100, save_every=7)
    plain = vi.ensemble(falling(), rule, backend="interpreted", **start)
    lanes = vi.ensemble(falling(), rule, backend="compiled", **start)
    assert lanes.failed.tolist() == plain.failed.tolist() and 0 < len(lanes.failed) < 16
    np.testing.assert_array_equal(lanes.good, plain.good)
    np.testing.assert_allclose(lanes.q.compressed(), plain.q.compressed(), atol=1e-12)
    assert "not defined where the step leads" in lanes.errors[0].cause
    alone = vi.ensemble(
        falling(), rule, backend="compiled", **start | dict(v0=v0[list(lanes.completed)])
    )
    assert alone.q.tobytes() == np.asarray(lanes.q[lanes.completed]).tobytes()


def pushed() -> vi.System:
    q, v, push = *vi.coordinates("x", "theta"), ca.SX.sym("push")
    lagrangian = v[0] ** 2 + v[0] * v[1] * ca.cos(q[1]) + v[1] ** 2 / 2 + 9.81 * ca.cos(q[1])
    return vi.System(q, v, lagrangian, force=ca.vertcat(push, 0), control=push)


@pytest.mark.parametrize("stages", [1, 2, 4])
@pytest.mark.parametrize(
    "scene", [double_pendulum, driven_damped, henon_heiles], ids=lambda f: f.__name__
)
def test_members_in_lanes_are_the_compiled_runs_of_simulate_to_round_off(scene, stages):
    """First- and second-order form, forces that depend on v and t; 19 members leave a vector
    half empty.
    """
    system, rule, rng = scene(), vi.gauss(stages), np.random.default_rng(7)
    q0, grid = (
        rng.normal(size=(19, 2)) / 3,
        dict(v0=[0.1, 0.0], h=0.03, steps=200, t0=0.5, backend="compiled"),
    )
    motions = vi.ensemble(system, rule, q0=q0, **grid)
    for i in range(19):
        one = vi.simulate(system, rule, q0=q0[i], **grid)
        np.testing.assert_allclose(motions.q[i], one.q, atol=2e-13)
        np.testing.assert_allclose(motions.p[i], one.p, atol=2e-13)
    alone = vi.ensemble(system, rule, q0=q0[11:12], **grid)
    assert alone.q[0].tobytes() == motions.q[11].tobytes(), "a neighbour shows"


def test_members_whose_iteration_does_not_contract_are_done_by_newtons_method():
    """hω of a pendulum of length 0.001 is 5: no contraction there, for its neighbours there is."""
    lengths = np.array([1.0, 0.5, 0.001, 2.0, 0.0015, 1.5, 1.0, 1.0, 0.7])
    start = dict(q0=0.02, v0=0.0, h=0.05, steps=300, params=dict(length=lengths))
    lanes = vi.ensemble(swinging(), vi.gauss(2), backend="compiled", **start)
    plain = vi.ensemble(swinging(), vi.gauss(2), backend="interpreted", **start)
    assert not len(lanes.failed) and (lanes.good == 301).all()
    np.testing.assert_allclose(lanes.q, plain.q, atol=1e-11)
    for i in (2, 4):
        assert lanes.q[i].tobytes() == plain.q[i].tobytes() and lanes[i].stats["residual"] > 0


@pytest.mark.parametrize("rule", [vi.composition("blanes-moan4"), vi.gauss(3)], ids=str)
def test_controls_of_members_in_lanes_are_those_of_simulate(rule):
    q, v, push = *vi.coordinates("x", "y"), ca.SX.sym("push")
    scene = vi.System(
        q, v, ca.sumsqr(v) / 2 - ca.sumsqr(q) ** 2, force=ca.vertcat(push, 0), control=push
    )
    rng = np.random.default_rng(8)
    q0, grid = rng.normal(size=(11, 2)), dict(v0=[0, 1.0], h=0.02, steps=60, save_every=7)
    tables = [rng.normal(size=(11, 60, 1)), rng.normal(size=(60, 1)), 0.4]
    if rule.points:
        tables.append(rng.normal(size=(11, 60, 3, 1)))
    for u in tables:
        lanes = vi.ensemble(scene, rule, q0=q0, u=u, backend="compiled", **grid)
        plain = vi.ensemble(scene, rule, q0=q0, u=u, backend="interpreted", **grid)
        np.testing.assert_allclose(lanes.q, plain.q, atol=1e-13)
        np.testing.assert_allclose(lanes.p, plain.p, atol=1e-13)


def test_round_off_of_members_in_lanes_does_not_drift():
    """Energy error of 1e5 steps: what compensated sums leave, as in a single run."""
    start = dict(q0=np.linspace(0.5, 2.5, 8), v0=0.0, h=0.05, steps=100_000, save_every=1000)
    motions = vi.ensemble(swinging(), vi.gauss(6), backend="compiled", **start)
    error = motions.energy - motions.energy[:, :1]
    assert np.abs(error).max() < 2e-13 and np.abs(error.mean(axis=1)).max() < 1e-13


@pytest.mark.parametrize("rule", [vi.gauss(2), vi.lobatto(3)], ids=str)
@pytest.mark.parametrize(
    "scene", [double_pendulum, driven_damped, henon_heiles], ids=lambda f: f.__name__
)
def test_every_kind_of_scene_is_the_loop_of_simulate_bit_for_bit(scene, rule):
    system, rng = scene(), np.random.default_rng(1)
    q0, v0, grid = (
        rng.normal(size=(7, 2)) / 3,
        rng.normal(size=(7, 2)) / 3,
        dict(h=0.03, steps=123, t0=0.5),
    )
    motions = vi.ensemble(system, rule, q0=q0, v0=v0, **grid)
    assert_members_are(
        motions, system, rule, [dict(q0=a, v0=b) for a, b in zip(q0, v0, strict=True)], **grid
    )


@pytest.mark.parametrize("shape", [(40, 1), (40, 2, 1)])
def test_controls_of_each_member_and_momenta_are_those_of_simulate(shape):
    system, rule, rng = pushed(), vi.gauss(2), np.random.default_rng(2)
    u, p0, grid = rng.normal(size=(5, *shape)), rng.normal(size=(5, 2)), dict(h=0.05, steps=40)
    motions = vi.ensemble(system, rule, q0=[0, 0.3], p0=p0, u=u, **grid)
    assert_members_are(
        motions, system, rule, [dict(q0=[0, 0.3], p0=p0[i], u=u[i]) for i in range(5)], **grid
    )
    shared = vi.ensemble(system, rule, q0=[0, 0.3], p0=p0, u=u[0], **grid)
    assert shared.q[0].tobytes() == motions.q[0].tobytes()


def test_scenes_with_constraints_and_matrix_parameters_are_the_loop_too():
    c = vi.Parameters(stiffness=np.eye(2), ell=1.0)
    q, v = vi.coordinates("x", "y")
    rod = ca.sumsqr(q) - c.ell**2
    system = vi.System(
        q, v, ca.sumsqr(v) / 2 - ca.bilin(c.stiffness, q, q) - 9.81 * q[1], constraint=rod, params=c
    )
    rng = np.random.default_rng(3)
    matrices, angle = rng.normal(size=(4, 2, 2)), np.array([0.1, 0.5, 1.0, 2.0])
    q0, grid = np.stack([np.sin(angle), -np.cos(angle)], axis=1), dict(h=0.02, steps=30)
    motions = vi.ensemble(system, q0=q0, v0=[0, 0], params=dict(stiffness=matrices), **grid)
    starts = [dict(q0=q0[i], v0=[0, 0], params=dict(stiffness=matrices[i])) for i in range(4)]
    assert_members_are(motions, system, None, starts, **grid)
    free = vi.System(q, v, ca.sumsqr(v) / 2 - ca.bilin(c.stiffness, q, q), params=c)
    motions = vi.ensemble(free, q0=q0, v0=[0, 0], params=dict(stiffness=matrices), **grid)
    assert_members_are(motions, free, None, starts, **grid)
    np.testing.assert_array_equal(motions.parameters["stiffness"], matrices)
    np.testing.assert_array_equal(motions[2].parameters["stiffness"], matrices[2])


def bouncing() -> vi.System:
    c = vi.Parameters(g=9.81)
    q, v = vi.coordinates("x", "y")
    return vi.System(q, v, ca.sumsqr(v) / 2 - c.g * q[1], contact=q[1], restitution=0.5, params=c)


@pytest.mark.parametrize("every", [1, 7])
def test_members_with_contacts_have_the_common_grid_in_arrays_and_their_events_alone(every):
    """Impacts at times of their own: nodes between those of the grid, more for some members than
    for others.
    """
    heights, grid = np.array([0.3, 1.0, 2.0]), dict(h=0.01, steps=150, save_every=every)
    q0, fields = np.stack([0 * heights, heights], axis=1), [9.81, 3.0, 20.0]
    motions = vi.ensemble(bouncing(), q0=q0, v0=[1.0, 0], params=dict(g=fields), **grid)
    assert motions.q.shape == (3, len(motions.k), 2) and not len(motions.failed)
    numbers = set()
    for i in range(3):
        one = vi.simulate(bouncing(), q0=q0[i], v0=[1.0, 0], params=dict(g=fields[i]), **grid)
        assert (
            motions[i].q.tobytes() == one.q.tobytes()
            and motions[i].events == one.events
            and one.events
        )
        numbers.add(len(one))
        at = [int(np.flatnonzero(one.k == k)[0]) for k in motions.k]
        np.testing.assert_array_equal(motions.t, one.t[at])
        assert (
            motions.q[i].tobytes() == one.q[at].tobytes()
            and motions.p[i].tobytes() == one.p[at].tobytes()
        )
        np.testing.assert_array_equal(motions.energy[i], one.energy[at])
        assert motions[i].stats["member"] == i
    assert len(numbers) == 3
    np.testing.assert_allclose(
        motions.mean(motions.system.q[1]), motions.q[:, :, 1].mean(axis=0), rtol=1e-14
    )


def test_members_with_redundant_constraints_have_the_multipliers_of_simulate():
    q, v = vi.coordinates("x", "y")
    twice = ca.vertcat(ca.sumsqr(q) - 1, 2 * ca.sumsqr(q) - 2)
    system, angle = (
        vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[1], constraint=twice),
        np.array([0.3, 1.0]),
    )
    q0, grid = np.stack([np.sin(angle), -np.cos(angle)], axis=1), dict(v0=[0, 0], h=0.02, steps=30)
    with pytest.warns(UserWarning, match="redundant"):
        motions = vi.ensemble(system, q0=q0, **grid)
    for i in range(2):
        with pytest.warns(UserWarning, match="redundant"):
            one = vi.simulate(system, q0=q0[i], **grid)
        np.testing.assert_array_equal(motions[i].multipliers, one.multipliers)
        np.testing.assert_array_equal(motions[i].v, one.v)


def test_statistics_need_neither_all_members_at_once_nor_levels_beyond_one(monkeypatch):
    from varint.ensembles import result

    motions = vi.ensemble(
        henon_heiles(), q0=np.random.default_rng(5).normal(size=(30, 2)) / 10, v0=[0.1, 0], **GRID
    )
    q = motions.system.q
    whole = motions.quantiles(q)
    monkeypatch.setattr(result, "MOST_NUMBERS", 100)
    np.testing.assert_array_equal(motions.quantiles(q), whole)
    np.testing.assert_array_equal(whole, np.quantile(motions.q, (0.05, 0.5, 0.95), axis=0))
    for levels in ([1.5], [-0.1], [], ["a"]):
        with pytest.raises(vi.InputError, match="levels"):
            motions.quantiles(q, levels)
    with pytest.raises(vi.InputError, match="needs two members"):
        vi.ensemble(henon_heiles(), q0=[[0.1, 0.1]], v0=[0, 0], **GRID).std(q)


GRID = dict(h=0.1, steps=50)


def test_chunks_of_any_size_give_the_same_bits(monkeypatch):
    system, grid = double_pendulum(), dict(h=0.02, steps=250, save_every=2)
    q0 = np.random.default_rng(4).normal(size=(53, 2))
    whole = vi.ensemble(system, q0=q0, v0=[0, 0], **grid)
    for group, sample, seconds, numbers in (
        (1, 1, 1e-9, 4_000_000),
        (3, 3, 0.01, 4_000_000),
        (1, 17, 10.0, 2000),
    ):
        monkeypatch.setattr(executor_module, "GROUP", group)
        monkeypatch.setattr(executor_module, "SAMPLE", sample)
        monkeypatch.setattr(executor_module, "SECONDS", seconds)
        monkeypatch.setattr(batch, "MOST_NUMBERS", numbers)
        again = vi.ensemble(system, q0=q0, v0=[0, 0], **grid)
        assert [chunk.first for chunk in again.chunks] != [
            chunk.first for chunk in whole.chunks
        ] or numbers == 2000
        assert again.q.tobytes() == whole.q.tobytes() and again.p.tobytes() == whole.p.tobytes()


def test_ranges_are_cut_without_loss():
    for ranges in ([(0, 100)], [(3, 1), (10, 5), (90, 10)], []):
        for sizes in ([1, 10], [7] * 50, []):
            pieces = _cut(ranges, sizes)
            members = [i for first, count in pieces for i in range(first, first + count)]
            assert members == [i for first, count in ranges for i in range(first, first + count)]


def falling() -> vi.System:
    q, v = vi.coordinates("x")
    return vi.System(q, v, v**2 / 2 - q + ca.sqrt(q))


@pytest.mark.parametrize("rule", [None, vi.gauss(2)], ids=str)
@pytest.mark.parametrize("every", [1, 10])
def test_a_member_that_fails_does_not_take_the_others_along(rule, every):
    system, grid = falling(), dict(h=0.01, steps=100, save_every=every)
    v0 = [0.0, -3.0, 0.1, -2.0, -0.5]
    motions = vi.ensemble(system, rule, q0=1.0, v0=v0, backend="interpreted", **grid)
    assert motions.failed.tolist() == [1, 3] and motions.completed.tolist() == [0, 2, 4]
    for i in motions.completed:
        one = vi.simulate(system, rule, q0=1.0, v0=v0[i], backend="interpreted", **grid)
        assert motions[i].q.tobytes() == one.q.tobytes()
    for i in motions.failed:
        with pytest.raises(vi.ConvergenceError) as caught:
            vi.simulate(system, rule, q0=1.0, v0=v0[i], backend="interpreted", **grid)
        error, own = caught.value, motions.errors[i]
        assert str(own) == str(error) and (own.step, own.time) == (error.step, error.time)
        assert motions[i].q.tobytes() == error.trajectory.q.tobytes() == own.trajectory.q.tobytes()
        assert motions.good[i] == len(error.trajectory)
        assert (
            motions.q.mask[i, : motions.good[i]].sum() == 0
            and motions.q.mask[i, motions.good[i] :].all()
        )
    for array in (motions.q, motions.p, motions.v, motions.energy):
        assert np.isfinite(array.compressed()).all() and np.ma.count(array) == motions.good.sum()
    np.testing.assert_array_equal(motions.mean(system.q), motions.q[[0, 2, 4], :, 0].mean(axis=0))


def test_statistics_are_those_of_the_members():
    system, rng = henon_heiles(), np.random.default_rng(5)
    q0 = rng.normal(size=(30, 2)) / 10
    motions = vi.ensemble(system, q0=q0, v0=[0.1, 0], h=0.1, steps=50)
    q, v = system.q, system.v
    np.testing.assert_allclose(motions.mean(q[0]), motions.q[:, :, 0].mean(axis=0), rtol=1e-14)
    np.testing.assert_allclose(motions.std(q), motions.q.std(axis=0, ddof=1), rtol=1e-12)
    np.testing.assert_allclose(
        motions.quantiles(v[1], [0.5])[0], np.median(motions.v[:, :, 1], axis=0), rtol=1e-14
    )
    matrix = motions.value(q @ v.T)
    np.testing.assert_allclose(
        matrix, motions.q[:, :, :, None] * motions.v[:, :, None, :], rtol=1e-14
    )
    for i in (0, 29, -1):
        np.testing.assert_array_equal(motions.energy[i], motions[i].energy)
        np.testing.assert_array_equal(motions.v[i], motions[i].v)
    figure = motions.plot(q[0], ca.sumsqr(v))
    assert all(axes.get_ylabel() for axes in figure.axes) and figure.axes[-1].get_xlabel()


def test_one_number_a_member_is_enough_for_one_coordinate():
    motions = vi.ensemble(swinging(), q0=[0.1, 0.2, 0.3], v0=0.0, h=0.1, steps=5)
    assert motions.q[:, 0, 0].tolist() == [0.1, 0.2, 0.3]
    assert [round(m.q[0, 0], 9) for m in motions] == [0.1, 0.2, 0.3]
    with pytest.raises(IndexError):
        motions[3]


def test_wrong_ensembles_are_refused_at_once():
    system, grid = swinging(), dict(h=0.1, steps=5)
    with pytest.raises(vi.InputError, match="no argument has a leading axis"):
        vi.ensemble(system, q0=0.1, v0=0.0, **grid)
    with pytest.raises(vi.InputError, match=r"numbers of members differ: \{'q0': 3, 'length': 4\}"):
        vi.ensemble(system, q0=[1, 2, 3], v0=0.0, params=dict(length=[1, 2, 3, 4]), **grid)
    with pytest.raises(vi.InputError, match=r"q0 is not finite in members \[1\]"):
        vi.ensemble(system, q0=[1, np.nan, 3], v0=0.0, **grid)
    with pytest.raises(vi.InputError, match=r"q0 has shape \(3, 3\); it must be \(2,\)"):
        vi.ensemble(double_pendulum(), q0=np.eye(3), v0=[0, 0], **grid)
    with pytest.raises(vi.InputError, match=r"unknown parameters \['lenght'\]"):
        vi.ensemble(system, q0=[1, 2], v0=0.0, params=dict(lenght=1.0), **grid)
    with pytest.raises(
        vi.InputError, match=r"mass matrix .* singular at the start of members \[2\]"
    ):
        vi.ensemble(system, q0=0.1, v0=0.0, params=dict(length=[1.0, 2.0, 0.0]), **grid)
    with pytest.raises(vi.InputError, match=r"not finite at the start of members \[0, 3\]"):
        vi.ensemble(falling(), q0=[-1.0, 1.0, 2.0, -3.0], v0=0.0, **grid)
    with pytest.raises(vi.InputError, match="must have a submit method"):
        vi.ensemble(system, q0=[1, 2], v0=0.0, executor=4, **grid)
    with pytest.raises(vi.InputError, match="give two of h, steps, duration"):
        vi.ensemble(system, q0=[1, 2], v0=0.0, h=0.1)
    with pytest.raises(vi.InputError, match="give v0 or p0, not both"):
        vi.ensemble(system, q0=[1, 2], v0=0.0, p0=0.0, **grid)
    with pytest.raises(vi.InputError, match="unknown backend 'fast'"):
        vi.ensemble(system, q0=[1, 2], v0=0.0, backend="fast", **grid)
    with pytest.raises(vi.VarintError, match="members are compiled together for compositions"):
        vi.ensemble(
            pushed(),
            vi.lobatto(3),
            q0=[[0, 0], [1, 1]],
            v0=[0, 0],
            u=1.0,
            backend="compiled",
            **grid,
        )
    with pytest.raises(vi.InputError, match="may be one table"):
        vi.ensemble(
            pushed(), vi.gauss(2), q0=[0, 0], v0=[0, 0], u=np.zeros((2, 2, 1)), h=0.1, steps=2
        )


@pytest.mark.parametrize("backend", ["interpreted", "compiled"])
def test_members_whose_energy_strays_are_named_in_one_warning(backend):
    """Beyond hω = 2 Verlet grows; the others are left in peace."""
    lengths = np.array([1.0, 0.02, 2.0, 0.01, 0.5])
    start = dict(q0=0.1, v0=0.0, h=0.1, steps=40, params=dict(length=lengths), backend=backend)
    with pytest.warns(
        UserWarning, match=r"the energy of 2 members .*\(member 1: .*members \[1, 3\]"
    ):
        vi.ensemble(swinging(), vi.composition("verlet"), **start)
    vi.ensemble(
        swinging(), vi.composition("verlet"), **start | dict(params=dict(length=lengths[[0, 2, 4]]))
    )


@pytest.mark.parametrize("wrong", ["q0", "v0", "gap"])
def test_a_bad_start_of_any_member_is_refused_before_one_moves(wrong, monkeypatch):
    from varint.ensembles import executor

    def never(*arguments):
        raise AssertionError("a member was stepped")

    monkeypatch.setattr(executor, "step_chunk", never)
    q, v = vi.coordinates("x", "y")
    held = dict(contact=q[1]) if wrong == "gap" else dict(constraint=ca.sumsqr(q) - 1)
    system = vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[1], **held)
    angles = np.linspace(0.1, 3, 50)
    q0, v0 = np.stack([np.cos(angles), np.sin(angles)], axis=1), np.zeros((50, 2))
    if wrong == "v0":
        v0[37] = q0[37]
    else:
        q0[37] *= -2
    with pytest.raises(vi.InputError, match=r"member 37: (q0|v0) violates"):
        vi.ensemble(system, q0=q0, v0=v0, h=0.01, steps=10)
