"""Members that fail or stray do so alone, and are named."""

from __future__ import annotations

import numpy as np
import pytest
from ensemble_scenes import falling, swinging

import varint as vi


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
