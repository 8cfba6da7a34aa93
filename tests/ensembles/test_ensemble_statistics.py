"""Statistics over the members are those of their arrays."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from ensemble_scenes import swinging
from scenes import henon_heiles

import varint as vi


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


def test_a_name_is_the_values_of_all_members_and_several_indices_are_refused_in_words():
    runs = vi.ensemble(swinging(), q0=[0.1, 0.2, 0.3], v0=0.0, h=0.1, steps=5)
    name = runs.system.names[0]
    assert np.array_equal(runs[name], runs.q[..., 0]) and runs[name].shape == (3, 6)
    assert np.array_equal(runs[np.int64(-1)].q, runs.q[2])
    for several in (slice(1, 3), [0, 1], 1.0):
        with pytest.raises(vi.InputError, match="motion of one member"):
            runs[several]
    with pytest.raises(IndexError):  # by which loops over it end
        runs[3]
