"""Controls at times within the steps, whoever made the motion."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import varint as vi

TIMES = np.array([0.03, 0.3, 0.5, 0.71, 1.4, 2.2, 2.9])


def pushed():
    q, v = vi.coordinates("x")
    u = ca.SX.sym("u")
    return vi.System(q, v, v**2 / 2 - q**2 / 2, force=u, control=u), u


def by_simulate(system: vi.System, table: np.ndarray) -> vi.Trajectory:
    return vi.simulate(system, vi.gauss(2), q0=0.1, v0=0.2, h=0.5, steps=6, u=table)


def by_path(system: vi.System, table: np.ndarray) -> vi.Trajectory:
    ends = by_simulate(system, table).q
    given = dict(q0=ends[0], q_end=ends[-1], duration=3.0, steps=6, u=table)
    return vi.least_action(system, vi.gauss(2), **given)


def by_ensemble(system: vi.System, table: np.ndarray) -> vi.Trajectory:
    given = dict(q0=[[0.1], [0.2]], v0=[[0.2], [0.2]], h=0.5, steps=6, u=table)
    return vi.ensemble(system, vi.gauss(2), **given)[0]


@pytest.mark.parametrize("made", [by_simulate, by_path, by_ensemble])
def test_controls_at_nodes_of_the_rule_are_lines_between_these(made):
    system, u = pushed()
    table = np.random.default_rng(0).standard_normal((6, 2, 1))
    step = (TIMES / 0.5).astype(int)
    a, b = vi.gauss(2).nodes
    share = (TIMES / 0.5 - step - a) / (b - a)
    wanted = table[step, 0, 0] * (1 - share) + table[step, 1, 0] * share
    assert made(system, table).at(TIMES).value(u) == pytest.approx(wanted, abs=1e-12)


def test_an_optimal_motions_controls_are_the_same_by_both_names():
    system, u = pushed()
    given = dict(q0=0, v0=0, end=dict(q=1, v=0), duration=3.0, cost=u**2, t0=1.0)
    for mesh in (None, [0, 0.05, 0.2, 0.4, 0.5, 0.8, 1.0]):
        motion = vi.optimal_control(system, vi.gauss(2), steps=6, mesh=mesh, **given)
        wanted = motion.u_at(1 + TIMES)[:, 0]
        assert motion.at(1 + TIMES).value(u) == pytest.approx(wanted, abs=1e-12)
