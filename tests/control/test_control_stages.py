"""The same problem to other solvers and by other kernels: Fatrop's chain of stages, compiled
kernels.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from control_scenes import U, move, particle, pendulum, replay_defect, swing

import varint as vi
from varint.codegen import cache, functions
from varint.control.build import build_control_solver
from varint.control.problem import choose_kernels, transcribe

models = vi.models


def sprung() -> vi.Phase:
    """A spring whose stiffness is to be chosen, forced in time, with a bound that is met."""
    q, v = vi.coordinates("x")
    t, c = vi.time(), vi.Parameters(stiffness=1.0)
    system = vi.System(
        q, v, v**2 / 2 - c.stiffness * q**2 / 2 + q * ca.cos(t), force=U, control=U, params=c, t=t
    )
    return vi.Phase(
        system,
        vi.gauss(3),
        vi.free(2.0, 1.0, 3.0),
        12,
        U**2 + c.stiffness**2 / 50 + 1,
        start=dict(q=[0], v=[0]),
        end=dict(q=[1], v=[None], bounds=[(0, q + v, 1.5)]),
        bounds=[(None, v, 0.8)],
        params=dict(stiffness=vi.free(1.0, 0.1, 5.0)),
    )


STAGED = {
    "gauss": lambda: models.swing_up_cart_pole(20, 3).phases[0],
    "constraint": lambda: models.swing_up_rod(20, 3).phases[0],
    "free duration and bounds": lambda: models.overhead_crane().phases[0],
    "other units": lambda: models.orbit_transfer().phases[0],
    "one value a step": lambda: replace(models.swing_up_pendulum().phases[0], control="constant"),
    "free end and parameter": sprung,
}


@pytest.mark.parametrize("name", STAGED)
def test_a_chain_of_stages_has_the_solution_and_the_multipliers_of_the_plain_program(name):
    phase = STAGED[name]()
    [one], [two] = (vi.optimal_phases([phase], solver=x) for x in ("ipopt", "fatrop"))
    assert two.cost == pytest.approx(one.cost, rel=2e-8)  # Fatrop relaxes bounds by 1e-8
    assert two.q == pytest.approx(one.q, abs=2e-6)
    for a, b in ((one.costates.p, two.costates.p), (one.costates.q, two.costates.q)):
        assert b == pytest.approx(a, abs=1e-5 * np.abs(a).max())
    assert two.p == pytest.approx(one.p, abs=1e-6 * np.abs(one.p).max())
    assert replay_defect(two) < 1e-9
    assert two.solution.iterations > 0 and two.solution.status == "Solved"


def test_fatrop_is_handed_one_stage_a_step():
    [phase] = models.swing_up_cart_pole(20, 3).phases
    one = transcribe([phase], [], 0.0)
    run = build_control_solver(one, np.zeros(one.unknowns) + 0.1, "fatrop")
    stats = run.order.options
    assert stats["N"] == 20
    assert stats["nx"] == [4] * 21  # (q, p)
    assert set(stats["nu"][1:-1]) == {3 + 4 + 2}  # u, inner points, q⁺
    assert sum(stats["nx"]) + sum(stats["nu"]) == len(run.order.source)


def test_fatrop_refuses_what_is_no_chain_and_says_what_it_cannot():
    walk, cat = models.walker(), models.falling_cat(0.2)
    with pytest.raises(vi.InputError, match="one phase"):
        vi.optimal_phases(walk.phases, walk.links, solver="fatrop")
    with pytest.raises(vi.InputError, match="periodic"):
        swing(pendulum(), 3.0, end=dict(periodic=[2 * np.pi]), solver="fatrop")
    # its angular momentum is given at both ends
    with pytest.raises(vi.SolverError, match="imply each other"):
        vi.optimal_phases(cat.phases, solver="fatrop", options={"fatrop": {"max_iter": 30}})


def test_predictive_control_by_stages_answers_like_that_of_the_plain_program():
    q, v = particle().q, particle().v
    ahead = vi.Phase(particle(), vi.gauss(2), 3.0, 15, q**2 + v**2 + U**2, bounds=[(-1, U, 1)])
    plain, staged = (
        vi.mpc(ahead, solver=name, backend="interpreted") for name in ("ipopt", "fatrop")
    )
    for state in ([2.0], [-0.3]):
        assert staged(state, [0.1]).u == pytest.approx(plain(state, [0.1]).u, abs=1e-6)


needs_compiler = pytest.mark.skipif(cache.compiler() is None, reason="no C compiler")


@needs_compiler
@pytest.mark.parametrize("name", ["ipopt", "fatrop"])
def test_compiled_kernels_find_what_interpreted_ones_find(name):
    [phase] = models.swing_up_cart_pole(20, 3).phases
    one, two = (
        vi.optimal_phases([phase], solver=name, backend=x)[0] for x in ("interpreted", "compiled")
    )
    assert two.cost == pytest.approx(one.cost, rel=1e-11)
    assert two.q == pytest.approx(one.q, abs=1e-8)
    assert two.solution.iterations == one.solution.iterations


@needs_compiler
def test_kernels_are_compiled_where_they_run_often_enough(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    x = ca.SX.sym("x", 3)
    f = ca.Function("f", [x], [ca.sin(x) * ca.norm_2(x)], {"cse": True})
    cache.library.cache_clear()
    few, many = (functions.compiled_where_it_pays([f], [calls])[0] for calls in (1e3, 1e9))
    assert few.class_name() == "SXFunction" and many.class_name() == "External"
    assert np.array(many([1, 2, 3])) == pytest.approx(np.array(f([1, 2, 3])), rel=1e-14)


def test_without_a_compiler_everything_works(monkeypatch):
    monkeypatch.setattr(cache, "compiler", lambda: None)
    monkeypatch.setattr(cache, "machine", cache.machine.__wrapped__)
    cache.library.cache_clear()
    kernels = choose_kernels("auto", 1e9)
    f = ca.Function("f", [ca.SX.sym("x")], [1])
    assert kernels([f] * 4, 10**6) == [f] * 4
    ahead = vi.Phase(
        particle(), vi.gauss(2), 3.0, 15, particle().q ** 2 + U**2, bounds=[(-1, U, 1)]
    )
    assert vi.mpc(ahead)([2.0], [0.0]).u[0, 0, 0] == pytest.approx(-1)
    with pytest.raises(cache.CompileError, match="no C compiler"):
        choose_kernels("compiled")([f], 1)


def test_backends_that_cannot_be_are_refused():
    with pytest.raises(vi.InputError, match=r"known: .*interpreted"):
        move(vi.gauss(2), 5, backend="gpu")
    with pytest.raises(vi.InputError, match=r"sqpmethod.*interpreted"):
        move(vi.gauss(2), 5, backend="compiled", solver="sqpmethod")
