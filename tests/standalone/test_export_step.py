"""A step as C99: what leaves is the step that Python makes, and strict compilers accept it."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from compiling import COMPILERS, STRICT, agreement, compiled, needs_compiler

import varint as vi


def motion_of(model: vi.models.Model, rule: vi.Rule | None = None, **given) -> vi.Trajectory:
    start = dict(q0=model.q0, v0=model.v0, h=model.h, steps=30)
    return vi.simulate(model.system, rule, **(start | given))


def forced() -> vi.Trajectory:
    """A pendulum on a pivot that moves, with friction and a torque at every node of the rule."""
    q, v, t, torque = *vi.coordinates("theta"), vi.time(), ca.SX.sym("torque")
    c = vi.Parameters(friction=0.1, Omega=7.0)
    height = 0.3 * ca.cos(c.Omega * t)
    L = v**2 / 2 + 9.81 * ca.cos(q) + height * ca.cos(q)
    force = torque - c.friction * v
    system = vi.System(q, v, L, force=force, control=torque, params=c, t=t)
    u = np.sin(np.arange(60)).reshape(30, 2, 1)
    return vi.simulate(
        system, vi.gauss(2), q0=[0.4], v0=[0.1], h=0.02, steps=30, u=u, t0=0.3,
        params=dict(friction=0.2),
    )  # fmt: skip


def relativistic() -> vi.Trajectory:
    """A momentum that is no linear function of the velocity."""
    q, v = vi.coordinates("x")
    system = vi.System(q, v, -ca.sqrt(1 - v**2) - q**2 / 2)
    return vi.simulate(system, vi.gauss(2), q0=[0.5], v0=[0.6], h=0.1, steps=30)


MOTIONS = {
    "pendulum_kick": lambda: motion_of(vi.models.pendulum()),
    "pendulum_newton": lambda: motion_of(vi.models.pendulum(), vi.gauss(4)),
    "double_pendulum": lambda: motion_of(vi.models.double_pendulum(), vi.gauss(3)),
    "linear": lambda: motion_of(vi.models.coupled_oscillators(), vi.gauss(2)),
    "uniform_field": lambda: motion_of(vi.models.block_on_wedge()),
    "rattle": lambda: motion_of(vi.models.pendulum_cartesian(), vi.lobatto(2)),
    "multipliers": lambda: motion_of(vi.models.pendulum_cartesian(), vi.lobatto(4)),
    "rolling": lambda: motion_of(vi.models.rolling_disc()),
    "driven": lambda: motion_of(vi.models.driven_pendulum(), vi.gauss(2)),
    "degenerate": lambda: motion_of(vi.models.lotka_volterra()),
    "degenerate_midpoint": lambda: motion_of(vi.models.lotka_volterra(), vi.midpoint()),
    "forced": forced,
    "relativistic": relativistic,
    "controlled_to_rest": lambda: vi.models.overhead_crane().solve()[0],
    "backward": lambda: motion_of(vi.models.double_pendulum(), vi.gauss(1), h=-0.01),
}


@needs_compiler
@pytest.mark.parametrize("name", MOTIONS)
def test_the_step_in_c_is_that_of_python_to_round_off(name, tmp_path):
    vi.export(MOTIONS[name](), tmp_path, name)
    status, off = agreement(tmp_path, name)
    assert status == 0
    assert off < 1e-13


@needs_compiler
def test_a_fitted_model_leaves_with_its_estimates(tmp_path):
    q, v = vi.coordinates("x")
    k, d = ca.SX.sym("k"), ca.SX.sym("d")
    spring = vi.System(q, v, v**2 / 2 - k * q**2 / 2, force=-d * v, params={k: 1.0, d: 0.0})
    start = dict(q0=1.0, v0=0.0, h=0.05)
    seen = vi.simulate(spring, vi.gauss(2), steps=100, params=dict(k=2.0, d=0.3), **start)
    data = [vi.Measurement(spring.q, seen.t, seen.q, 1e-3)]
    fit = vi.fit(spring, vi.gauss(2), data=data, unknown=["k", "d"], **start)
    _, source, _ = vi.export(fit.trajectories[0], tmp_path, "decay")
    assert agreement(tmp_path, "decay") < (0, 1e-13)
    text = source.read_text().split("decay_params[2] = {")[1].split("}")[0]
    found = [float(x) for x in text.split(",") if x.strip()]
    assert found == fit.estimates.tolist()
    np.testing.assert_allclose(found, [2.0, 0.3], rtol=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize("name", MOTIONS)
def test_optimising_compilers_warn_of_nothing_and_change_nothing(name, compiler, tmp_path):
    vi.export(MOTIONS[name](), tmp_path, name)
    for options in (("-O2",), ("-O3", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")):
        status, off = agreement(tmp_path, name, compiler=compiler, options=options)
        assert status == 0
        assert off < 1e-13


@needs_compiler
def test_the_test_program_finds_a_step_that_is_not_python_s(tmp_path):
    vi.export(MOTIONS["driven"](), tmp_path, "driven")
    text = (tmp_path / "driven_test.c").read_text()
    assert "t0 + k * h" in text
    (tmp_path / "driven_test.c").write_text(text.replace("t0 + k * h", "t0 + k * h + 1e-6"))
    assert agreement(tmp_path, "driven")[0] == 1


def test_nothing_in_the_source_allocates_or_belongs_to_casadi_s_library(tmp_path):
    header, source, _ = vi.export(MOTIONS["rattle"](), tmp_path, "rattle")
    text = source.read_text()
    for word in ("malloc", "free(", "printf", "casadi.h", "CASADI_SYMBOL_EXPORT"):
        assert word not in text
    includes = [line for line in text.splitlines() if line.startswith("#include")]
    assert includes == ['#include "rattle.h"', "#include <math.h>"]
    assert "no allocation" in header.read_text()


FAILS = r"""
#include <stdio.h>
#include <stdlib.h>
#include "stiff.h"
int main(int count, char **words) {
    double q[1] = {0.4}, p[1] = {3.0}, h = count > 1 ? atof(words[1]) : 0;
    double state[STIFF_STATE], before[STIFF_STATE], report[2];
    int i, same = 1, status;
    stiff_start(q, p, 0, 0, 0, h, state);
    for (i = 0; i < STIFF_STATE; ++i) before[i] = state[i];
    status = stiff_step(state, 0, 0, 0, h, report);
    for (i = 0; i < STIFF_STATE; ++i) same = same && before[i] == state[i];
    printf("%d %d %g %g\n", status, same, report[0], report[1]);
    return 0;
}
"""


def how_it_ends(program: Path, h: str) -> list[float]:
    """Status, whether the state is as it was, iterations, residual of one step of size h."""
    done = subprocess.run([program, h], capture_output=True, text=True, check=True)
    return [float(x) for x in done.stdout.split()]


@needs_compiler
def test_a_step_without_an_answer_says_so_and_leaves_the_state_alone(tmp_path):
    q, v = vi.coordinates("x")
    system = vi.System(q, v, (1 + ca.sin(3 * q) / 2) * v**2 / 2 + ca.cos(5 * q))
    motion = vi.simulate(system, vi.gauss(2), q0=[0.4], v0=[0.2], h=0.01, steps=10)
    vi.export(motion, tmp_path, "stiff", iterations=7)
    (tmp_path / "fails.c").write_text(FAILS)
    program = compiled(tmp_path, "stiff.c", "fails.c")
    status, same, iterations, residual = how_it_ends(program, "0.01")
    assert (status, same) == (0, 0)
    assert 0 < iterations <= 7
    assert residual < 1e-12
    status, same, *_ = how_it_ends(program, "1e200")
    assert (status, same) == (2, 1)
    few = compiled(tmp_path, "stiff.c", "fails.c", options=("-O0", "-DSTIFF_ITERATIONS=2"))
    status, same, iterations, residual = how_it_ends(few, "0.3")
    assert (status, same, iterations) == (1, 1, 2)
    assert residual > 1e-10


@needs_compiler
@pytest.mark.skipif(not shutil.which("g++"), reason="needs g++")
def test_c_plus_plus_calls_it_too(tmp_path):
    vi.export(MOTIONS["pendulum_kick"](), tmp_path, "swing")
    text = '#include "swing.h"\nint main() { return swing_step(0, 0, 0, 0, 0, 0) == 7; }\n'
    (tmp_path / "main.cpp").write_text(text)
    for line in (["gcc", *STRICT, "-c", "swing.c"], ["g++", "main.cpp", "swing.o", "-lm"]):
        subprocess.run(line, cwd=tmp_path, check=True)


def test_what_no_bounded_step_makes_is_refused(tmp_path):
    ball = motion_of(vi.models.bouncing_ball())
    with pytest.raises(vi.InputError, match="contacts"):
        vi.export(ball, tmp_path, "ball")
    kepler = vi.models.kepler()
    start = dict(q0=kepler.q0, v0=kepler.v0, time_scale="auto")
    near = vi.simulate(kepler.system, h=0.2, steps=20, **start)
    with pytest.raises(vi.InputError, match="variable steps"):
        vi.export(near, tmp_path, "near")
    motion = MOTIONS["pendulum_kick"]()
    for name in ("2nd", "two links", "a__b", "", None, "_a", "π"):
        with pytest.raises(vi.InputError, match="name must begin what is defined in C"):
            vi.export(motion, tmp_path, name)
    with pytest.raises(vi.InputError, match="a motion or a controller, got System"):
        vi.export(motion.system, tmp_path, "pendulum")
    with pytest.raises(vi.InputError, match="along= is for controllers"):
        vi.export(motion, tmp_path, "pendulum", along=motion)
    with pytest.raises(vi.InputError, match="iterations"):
        vi.export(motion, tmp_path, "pendulum", iterations=0)
    with pytest.raises(vi.InputError, match="takes the path of a folder"):
        vi.export(motion, 3, "pendulum")
    (tmp_path / "file").write_text("")
    with pytest.raises(vi.InputError, match="is a file"):
        vi.export(motion, tmp_path / "file", "pendulum")
    with pytest.raises(vi.InputError, match="cannot make the folder"):
        vi.export(motion, tmp_path / "file" / "below", "pendulum")
    assert not list(tmp_path.glob("*.c"))
