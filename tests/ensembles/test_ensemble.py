"""Ensembles are bit for bit the loop of `simulate`, whatever the scene and the chunks."""

from __future__ import annotations

import os
import sys

import casadi as ca
import numpy as np
import pytest
from ensemble_scenes import pushed, swinging
from scenes import double_pendulum, driven_damped, henon_heiles

import varint as vi
from varint.ensembles import batch
from varint.ensembles import executor as executor_module
from varint.ensembles.executor import _cut
from varint.numerics import progress


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
            one = vi.simulate(system, q0=q0[i], **grid, backend="interpreted")
        np.testing.assert_array_equal(motions[i].multipliers, one.multipliers)
        np.testing.assert_array_equal(motions[i].v, one.v)


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


def test_one_number_a_member_is_enough_for_one_coordinate():
    motions = vi.ensemble(swinging(), q0=[0.1, 0.2, 0.3], v0=0.0, h=0.1, steps=5)
    assert motions.q[:, 0, 0].tolist() == [0.1, 0.2, 0.3]
    assert [round(m.q[0, 0], 9) for m in motions] == [0.1, 0.2, 0.3]
    with pytest.raises(IndexError):
        motions[3]


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
def test_a_terminal_that_does_not_know_its_size_shows_a_bar(monkeypatch):
    """Pseudo-terminals of containers and of `script` have no columns and no rows."""
    keeper, terminal = os.openpty()
    os.set_blocking(keeper, False)
    with os.fdopen(terminal, "w") as shown:
        monkeypatch.setattr(sys, "stderr", shown)
        monkeypatch.setattr(progress, "PATIENCE", 0.0)
        vi.ensemble(swinging(), q0=np.linspace(0.1, 1, 40), v0=0.0, duration=5.0)
        shown.flush()
        assert b"/40" in os.read(keeper, 10_000)
    os.close(keeper)
