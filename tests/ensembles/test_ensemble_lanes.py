"""Members compiled together, several in one vector: the motion of `simulate` to round-off."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from ensemble_scenes import swinging
from scenes import double_pendulum, driven_damped, henon_heiles

import varint as vi
from varint.ensembles import executor as executor_module

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
