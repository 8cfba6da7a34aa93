"""A predictive controller as C99: bounded iterations, an answer whatever happens."""

from __future__ import annotations

import subprocess

import casadi as ca
import numpy as np
import pytest
from compiling import COMPILERS, agreement, compiled, needs_compiler

import varint as vi


def arm_controller(steps: int = 5, **given) -> vi.Controller:
    """Two links led to a set-point by torques that are too weak to do it at once."""
    s, goal = vi.models.two_link_arm().system, ca.SX.sym("goal", 2)
    params = [(getattr(s.params, name), value) for name, value in s.defaults.items()]
    params += [(goal, [0.9, 0.6])]
    arm = vi.System(s.q, s.v, s.lagrangian, force=s.force, control=s.control, params=params)
    off, torque = ca.sumsqr(arm.q - goal), arm.control
    cost = 40 * off + ca.sumsqr(arm.v) + 0.02 * ca.sumsqr(torque)
    limits = [(-4, torque[0], 4), (-2, torque[1], 2)]
    phase = dict(terminal_cost=20 * off + 2 * ca.sumsqr(arm.v), bounds=limits) | given
    return vi.mpc(vi.Phase(arm, vi.midpoint(), 0.06 * steps, steps, cost, **phase))


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    """The folder with the controller in C, the controller, and a motion of its closed loop."""
    folder, controller = tmp_path_factory.mktemp("arm"), arm_controller()
    motion, _ = vi.closed_loop(controller, [0.3, 0.8], [0.0, 0.0], 12)
    vi.export(controller, folder, "reach", along=motion)
    return folder, controller, motion


@needs_compiler
def test_the_controller_in_c_is_that_of_python_to_round_off(arm):
    status, off = agreement(arm[0], "reach")
    assert status == 0
    assert off < 1e-12


@pytest.mark.long
@pytest.mark.parametrize("compiler", COMPILERS)
def test_optimising_compilers_warn_of_nothing_in_a_controller(arm, compiler):
    for options in (
        ("-O2",),
        ("-Og",),
        ("-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"),
    ):
        status, off = agreement(arm[0], "reach", compiler=compiler, options=options)
        assert status == 0
        assert off < 1e-9


LOOP = r"""
#include <stdio.h>
#include "reach.h"
int main(void) {
    static double memory[REACH_MEMORY];
    double x[4], goal, u[2], params[REACH_PARAMETERS], report[1];
    int ahead, i, status;
    for (i = 0; i < REACH_PARAMETERS; ++i) params[i] = reach_params[i];
    reach_start(memory);
    while (scanf("%d %lf %lf %lf %lf %lf", &ahead, x, x + 1, x + 2, x + 3, &goal) == 6) {
        params[REACH_PARAMETERS - 1] = goal;
        status = reach_step(memory, x, x + 2, 0, params, ahead, u, report);
        printf("%d %.17g %.17g %g\n", status, u[0], u[1], report[0]);
    }
    return 0;
}
"""
JUMP = 6 * [0.6] + 6 * [1.4]  # of the elbow's set-point
AHEAD = [0] + 11 * [1]


@pytest.fixture(scope="module")
def loop(arm):
    """The program of a loop that reads states and set-points."""
    (arm[0] / "loop.c").write_text(LOOP)
    return compiled(arm[0], "reach.c", "loop.c").rename(arm[0] / "loop")


@pytest.fixture(scope="module")
def short(arm, loop):
    """The same with one quadratic program a call."""
    options = "-O0", "-DREACH_ITERATIONS=1", "-DREACH_TOLERANCE=1e-9"
    return compiled(arm[0], "reach.c", "loop.c", options=options).rename(arm[0] / "short")


def answers(program, states: np.ndarray, ahead=AHEAD, goal=JUMP) -> np.ndarray:
    """Status, controls and residual at each of the states (q, v)."""
    rows = zip(ahead, states.tolist(), goal, strict=True)
    lines = "\n".join(" ".join(map(str, [k, *x, y])) for k, x, y in rows)
    done = subprocess.run([program], input=lines, capture_output=True, text=True, check=True)
    return np.loadtxt(done.stdout.splitlines())


@needs_compiler
def test_it_plans_what_ipopt_plans_also_where_bounds_hold_and_the_set_point_moves(arm, loop):
    _, controller, motion = arm
    states, plan = np.hstack([motion.q, motion.v])[:12], None
    status, *u, residual = answers(loop, states).T
    assert (status == 0).all()
    assert (residual < 1e-9).all()
    limited = 0
    for k in range(12):
        params = dict(goal=[0.9, JUMP[k]])
        plan = controller(motion.q[k], motion.v[k], plan, params=params)
        asked = plan.u[0, 0]
        assert np.array(u)[:, k] == pytest.approx(asked, abs=1e-4)
        limited += int(np.abs(asked[0]) > 4 - 1e-6)
    assert limited


@needs_compiler
def test_a_call_without_a_plan_in_time_gives_the_controls_of_the_former_plan(arm, loop, short):
    """At the jump one quadratic program is not enough for the tolerance."""
    _, controller, motion = arm
    states = np.hstack([motion.q, motion.v])[:12]
    strict = answers(short, states)
    assert (strict[:, 0] == 1).any()
    assert (strict[strict[:, 0] == 1, 3] > 1e-9).all()
    full = answers(loop, states)
    with_nan = states.copy()
    with_nan[4:7, 1] = np.nan
    broken = answers(loop, with_nan)
    assert broken[:, 0].tolist() == [0, 0, 0, 0, *3 * [broken[4, 0]], 0, 0, 0, 0, 0]
    assert broken[4, 0] == 2
    assert broken[:4] == pytest.approx(full[:4], abs=1e-12)
    former = None
    for k in range(4):
        former = controller(motion.q[k], motion.v[k], former)
    assert broken[4:7, 1:3] == pytest.approx(former.u[1:4, 0], abs=1e-4)
    assert broken[7:, 1:3] == pytest.approx(full[7:, 1:3], abs=1e-6)


@needs_compiler
def test_calls_that_are_too_short_go_on_from_one_another(arm, loop, short):
    """A set-point that jumps, and one quadratic program a call at the same state: the plan is
    found after some calls, and until then the controls are the former ones.
    """
    _, _, motion = arm
    state, calls = np.append(motion.q[6], motion.v[6]), 12
    given = dict(states=np.tile(state, (calls, 1)), ahead=calls * [0], goal=[0.6, *11 * [1.4]])
    status, *u, residual = answers(short, **given).T
    full = answers(loop, **given)
    tried = np.flatnonzero(status[1:] == 1) + 1
    assert 1 <= len(tried) < calls - 2
    assert tried.tolist() == list(range(1, 1 + len(tried)))
    assert status[tried[-1] + 1 :].tolist() == (calls - 1 - len(tried)) * [0]
    assert (np.diff(residual[tried]) < 0).all()
    assert np.array(u)[:, -1] == pytest.approx(full[-1, 1:3], abs=1e-6)


def test_what_no_controller_in_c_can_be_is_refused(arm, tmp_path):
    _, controller, motion = arm
    with pytest.raises(vi.InputError, match="takes along="):
        vi.export(controller, tmp_path, "reach")
    other = vi.simulate(vi.models.pendulum().system, q0=[0.1], v0=[0.0], h=0.1, steps=3)
    with pytest.raises(vi.InputError, match="a motion of 1 coordinates, the controller has 2"):
        vi.export(controller, tmp_path, "reach", along=other)
    impossible = arm_controller(end=dict(q=[9.0, 9.0]))
    with pytest.raises(vi.InputError, match="finds no controls at node 0"):
        vi.export(impossible, tmp_path, "reach", along=motion)
    q, v = vi.coordinates("x", "y")
    push = ca.SX.sym("push", 2)
    bead = vi.System(q, v, ca.sumsqr(v) / 2, constraint=ca.sumsqr(q) - 1, force=push, control=push)
    held = vi.mpc(vi.Phase(bead, vi.lobatto(3), 1.0, 3, ca.sumsqr(push) + q[0] ** 2))
    with pytest.raises(vi.InputError, match="constraints"):
        vi.export(held, tmp_path, "bead", along=motion)
    assert not list(tmp_path.iterdir())
