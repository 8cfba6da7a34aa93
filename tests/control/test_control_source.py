"""A controller written as C."""

from __future__ import annotations

import shutil
import subprocess

import casadi as ca
import numpy as np
import pytest
from control_scenes import U, particle

import varint as vi

CC = shutil.which("cc") or shutil.which("gcc")


def follow(**given) -> vi.Controller:
    """The particle follows a set-point with a limited push."""
    c = vi.Parameters(goal=1.0)
    q, v = vi.coordinates("x")
    system = vi.System(q, v, v**2 / 2 - q**4 / 4, force=U, control=U, params=c)
    cost = 5 * (q - c.goal) ** 2 + v**2 + U**2
    return vi.mpc(vi.Phase(system, vi.midpoint(), 1.5, 5, cost, bounds=[(-1, U, 1)], **given))


def closed(step, controller: vi.Controller, steps: int = 4):
    """Arguments and answers of some calls, the state of each the plan of the one before."""
    x, lam_x, lam_g = controller.start, np.zeros(len(controller.start)), 0
    q, v, plan = np.array([-0.5]), np.array([0.3]), None
    for k in range(steps):
        given = [q, v, 0.3 * k, [0.8], x, lam_x, lam_g]
        found = step(*given)
        plan = controller(q, v, plan, 0.3 * k, dict(goal=0.8))
        yield given, found, plan
        x, lam_x, lam_g = found[1:4]
        q, v = plan.q[1], plan.v[1]


def test_the_function_that_becomes_c_gives_the_controllers_controls(tmp_path):
    controller = follow()
    step = controller.source(tmp_path / "step.c")
    limited = 0
    for _, (u, *_, residual), plan in closed(step, controller):
        assert float(residual) < 1e-9
        assert pytest.approx(plan.u[0], abs=1e-7) == np.array(u).T
        limited += bool(np.abs(plan.u[0]).max() > 1 - 1e-6)
    assert limited


@pytest.mark.long
@pytest.mark.skipif(CC is None, reason="needs a C compiler")
def test_the_c_file_compiles_without_a_warning_and_gives_the_same_numbers(tmp_path):
    controller = follow()
    step = controller.source(tmp_path / "step.c", "follow")
    made = subprocess.run(
        [CC, "-Wall", "-Werror", "-shared", "-fPIC", "step.c", "-o", "step.so", "-lm"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert made.returncode == 0, made.stderr
    compiled = ca.external("follow", str(tmp_path / "step.so"))
    begin = ca.external("follow_start", str(tmp_path / "step.so"))()
    assert np.array(begin["x"]).ravel() == pytest.approx(controller.start, abs=0)
    for given, found, _ in closed(step, controller):
        for here, there in zip(found, compiled(*given), strict=True):
            assert np.array(there) == pytest.approx(np.array(here), rel=1e-13, abs=1e-13)


def test_a_state_that_has_no_solution_shows_in_the_residual(tmp_path):
    """From x = 0 nobody is at 9 in 1.5 s with this push."""
    controller = follow(end=dict(q=[9.0]))
    step = controller.source(tmp_path / "step.c")
    n = len(controller.start)
    residual = step([0.0], [0.0], 0.0, [1.0], controller.start, np.zeros(n), 0)[4]
    assert not float(residual) < 1e-3


@pytest.mark.skipif(CC is None, reason="needs a C compiler")
def test_what_is_no_number_shows_in_the_residual_of_the_c_function(tmp_path):
    controller = follow()
    controller.source(tmp_path / "step.c", "follow")
    line = [CC, "-shared", "-fPIC", "step.c", "-o", "step.so", "-lm"]
    subprocess.run(line, cwd=tmp_path, check=True)
    step = ca.external("follow", str(tmp_path / "step.so"))
    given = [[0.1], [0.2], 0.0, [1.0], controller.start, 0, 0]
    assert float(step(*given)[4]) < 1e-9
    for broken in range(4):  # state, velocity, time, set-point
        wrong = [np.nan if i == broken else x for i, x in enumerate(given)]
        assert float(step(*wrong)[4]) == np.inf


def test_what_cannot_be_written_is_refused(tmp_path):
    controller = follow()
    with pytest.raises(vi.InputError, match=r"ends in \.c"):
        controller.source(tmp_path / "step.txt")
    with pytest.raises(vi.InputError, match="name in C"):
        controller.source(tmp_path / "step.c", "2 steps")
    q, v = vi.coordinates("x", "y")
    push = ca.SX.sym("push", 2)
    bead = vi.System(q, v, ca.sumsqr(v) / 2, constraint=ca.sumsqr(q) - 1, force=push, control=push)
    held = vi.mpc(vi.Phase(bead, vi.lobatto(3), 1.0, 3, ca.sumsqr(push) + q[0] ** 2))
    with pytest.raises(vi.InputError, match="does not handle constraints"):
        held.source(tmp_path / "step.c")


def test_a_reference_over_the_horizon_is_followed():
    """A cost that depends on time: where sin t is followed at no cost of the push, so it is."""
    q, v, t = particle().q, particle().v, vi.time()
    system = vi.System(q, v, v**2 / 2, force=U, control=U, t=t)
    cost = (q - ca.sin(t)) ** 2 + (v - ca.cos(t)) ** 2 + (U + ca.sin(t)) ** 2
    controller = vi.mpc(vi.Phase(system, vi.gauss(3), 1.0, 4, cost))
    for now in (0.0, 0.7):
        plan = controller([np.sin(now)], [np.cos(now)], t=now)
        assert plan.q[:, 0] == pytest.approx(np.sin(now + np.linspace(0, 1, 5)), abs=1e-6)
        assert plan.solution.timings["solve"] > 0
