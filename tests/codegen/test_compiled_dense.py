"""Compiled Gauss steps of scenes with a large full inertia matrix, whose velocities conjugate
gradients find.
"""

import os
import subprocess
import sys
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.codegen import gauss
from varint.codegen.arguments import DONE, NOT_CONVERGED
from varint.codegen.built import built_library
from varint.codegen.cache import compiler
from varint.codegen.gauss import gauss_kernel
from varint.codegen.kernel import run_loop, take_parts
from varint.codegen.native import native_gauss
from varint.discrete.legendre import full_inertia, velocity_function

pytestmark = pytest.mark.skipif(compiler() is None, reason="no C compiler")
LINKS = 22
CONTROLS = np.random.default_rng(3).uniform(-1, 1, (12, 3, 1))


def kinetic(q, v, masses):
    """Links of unit length, as angles."""
    speed, energy = ca.SX.zeros(2), ca.SX(0)
    for i in range(q.numel()):
        speed += v[i] * ca.vertcat(ca.cos(q[i]), ca.sin(q[i]))
        energy += masses[i] * ca.sumsqr(speed) / 2
    return energy


def chain(links=LINKS, g=9.81):
    q, v = vi.coordinates(*(f"a{i}" for i in range(links)))
    weights = np.arange(links, 0, -1)
    return vi.System(q, v, kinetic(q, v, np.ones(links)) + g * ca.dot(ca.SX(weights), ca.cos(q)))


def driven():
    """With time, parameters, a control, damping, and terms of the momentum that do not depend on
    the velocity.
    """
    q, v = vi.coordinates(*(f"a{i}" for i in range(LINKS)))
    t, c, u = vi.time(), vi.Parameters(m=np.linspace(1, 2, LINKS), k=1.3), ca.SX.sym("u")
    swept = c.k * v[0] * ca.sin(q[1]) + v[2] * ca.cos(t) * q[3]
    stretch = ca.sumsqr(q[1:] - q[:-1])
    force = ca.vertcat(u * ca.cos(q[0]), -0.3 * v[1:])
    return vi.System(
        q, v, kinetic(q, v, c.m) + swept - c.k * stretch, force=force, control=u, params=c, t=t
    )


def start(links=LINKS):
    return 0.5 + 0.1 * (-1.0) ** np.arange(links), np.zeros(links)


@pytest.fixture(scope="module")
def hanging():
    return chain()


@pytest.mark.parametrize("stages", (1, 2, 3))
def test_a_chain_moves_as_with_the_interpreted_backend(hanging, stages):
    q0, v0 = start()
    options = {"q0": q0, "v0": v0, "h": 0.02, "steps": 12, "progress": False}
    found, wanted = (
        vi.simulate(hanging, vi.gauss(stages), backend=backend, **options)
        for backend in ("compiled", "interpreted")
    )
    assert full_inertia(hanging) and "velocities and forces" in found.stats["backend"]
    assert np.abs(found.q - wanted.q).max() < 1e-13
    assert np.abs(found.p - wanted.p).max() < 1e-13 * np.abs(wanted.p).max()


def test_time_controls_parameters_damping_and_a_momentum_at_rest_enter_as_they_should():
    system = driven()
    q0, v0 = start()
    options = {
        "q0": q0,
        "v0": v0 + 0.3,
        "h": 0.02,
        "steps": 12,
        "t0": 0.7,
        "u": CONTROLS,
        "progress": False,
    }
    found, wanted = (
        vi.simulate(system, vi.gauss(3), backend=backend, **options)
        for backend in ("compiled", "interpreted")
    )
    assert np.abs(found.q - wanted.q).max() < 1e-13
    assert np.abs(found.p - wanted.p).max() < 1e-13 * np.abs(wanted.p).max()


def test_the_velocity_belongs_to_the_momentum():
    system = driven()
    rng = np.random.default_rng(5)
    q, v = rng.uniform(-1, 1, (2, LINKS))
    momentum = ca.Function("momentum", [system.q, system.v, system.t, system.c], [system.momentum])
    p, c = np.array(momentum(q, v, 0.4, system.default_vector)).ravel(), system.default_vector
    assert np.abs(np.array(velocity_function(system)(q, p, 0.4, c)).ravel() - v).max() < 1e-12
    kernel = gauss_kernel(system, vi.gauss(3))
    found = run_loop(kernel, q, p, c, t0=0.4, h=1e-3, steps=1, u=CONTROLS[:1])
    assert np.abs(found.rows[0] - [q, p, v]).max() < 1e-12


def test_energy_and_angular_momentum_of_a_free_chain_stay_at_round_off():
    free = chain(g=0.0)
    q0 = start()[0]
    motion = vi.simulate(
        free,
        vi.gauss(8),
        q0=q0,
        v0=np.linspace(0.5, 1, LINKS),
        h=0.01,
        steps=2000,
        save_every=20,
        backend="compiled",
        progress=False,
    )
    energy, turning = motion.energy, motion.p.sum(axis=1)
    assert motion.stats["backend"].startswith("compiled")
    assert np.abs(motion.q[-1] - q0).max() > 10
    assert np.abs(energy / energy[0] - 1).max() < 2e-14
    assert np.abs(turning / turning[0] - 1).max() < 2e-15


@pytest.mark.parametrize("stages", (1, 2, 3, 4, 8, 11))
@pytest.mark.parametrize("scene", ("hanging", "driven"))
def test_the_scene_as_data_gives_the_same_bytes(stages, scene, hanging):
    system, rule = (hanging if scene == "hanging" else driven()), vi.gauss(stages)
    q0, v0 = start()
    u = np.random.default_rng(stages).uniform(-1, 1, (12, stages, 1)) if scene == "driven" else None
    motions = [
        vi.simulate(
            system, rule, q0=q0, v0=v0 + 0.3, h=0.02, steps=12, t0=0.7, u=u, backend=backend
        )
        for backend in ("native", "compiled")
    ]
    for name in ("q", "v", "p"):
        assert np.array_equal(*(getattr(motion, name) for motion in motions))
    between = 0.7 + np.linspace(0, 0.24, 9)
    assert np.array_equal(*(motion.at(between).q for motion in motions))
    assert "native" in motions[0].stats["backend"]


FILLED = """
#include <stddef.h>
#include <string.h>
void *__libc_memalign(size_t, size_t);
void *aligned_alloc(size_t a, size_t size) {
    void *found = __libc_memalign(a, size);
    return found ? memset(found, 0xff, size) : found;
}
"""


@pytest.mark.skipif(sys.platform != "linux", reason="memory is filled by the GNU C library's names")
@pytest.mark.skipif(built_library() is None, reason="built without a compiler")
def test_what_memory_holds_changes_nothing(tmp_path):
    """The factorisation goes by blocks of eight rows; behind the last one are zeros, and not what
    memory holds: here no numbers.
    """
    script = (
        "import numpy as np, varint as vi\n"
        "from test_compiled_dense import chain, start\n"
        "for links in (21, 29):\n"
        "    q0, v0 = start(links)\n"
        "    how = dict(q0=q0, v0=v0, h=0.02, steps=5, backend='native')\n"
        "    motion = vi.simulate(chain(links), vi.gauss(4), **how)\n"
        "    print(motion.stats['iterations'], motion.q[-1].tobytes().hex())\n"
    )
    source, filled = tmp_path / "filled.c", tmp_path / "filled.so"
    source.write_text(FILLED)
    subprocess.run([*compiler(), "-shared", "-fPIC", "-o", filled, source], check=True)
    told = [
        subprocess.run(
            [sys.executable, "-c", script],
            capture_output=True,
            text=True,
            check=True,
            cwd=Path(__file__).parent,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)} | preloaded,
        ).stdout
        for preloaded in ({}, {"LD_PRELOAD": str(filled)})
    ]
    assert len(told[0].split()) == 4 and told[0] == told[1]


@pytest.mark.parametrize("lanes", (4, 2, 1))
def test_shorter_vectors_give_the_same_motion(lanes, hanging, monkeypatch, forget):
    q0, p0 = start()
    rows = []
    for stages in (3, 5):
        wide = run_loop(
            gauss_kernel(hanging, vi.gauss(stages)), q0, p0, np.zeros(0), t0=0.0, h=0.02, steps=12
        )
        with monkeypatch.context() as patch:
            forget()
            patch.setattr(gauss, "vector_length", lambda: lanes)
            narrow = run_loop(
                gauss_kernel(chain(), vi.gauss(stages)),
                q0,
                p0,
                np.zeros(0),
                t0=0.0,
                h=0.02,
                steps=12,
            )
        rows.append(
            np.abs(narrow.rows - wide.rows).max(axis=(0, 2)) / np.abs(wide.rows).max(axis=(0, 2))
        )
    assert np.max(rows) < 2e-13


@pytest.mark.parametrize("level", (0.0, 1e-7))
def test_a_run_in_pieces_is_bitwise_the_run_in_one(level, hanging):
    kernel, (q0, p0) = gauss_kernel(hanging, vi.gauss(3)), start()
    options = {"t0": 0.3, "h": 0.02, "level": level}
    whole = run_loop(kernel, q0, p0, np.zeros(0), steps=30, **options)
    rows, carry = [whole.rows[:1]], None
    for first in (0, 10, 20):
        piece = run_loop(kernel, q0, p0, np.zeros(0), steps=10, first=first, carry=carry, **options)
        carry = piece.carry
        rows.append(piece.rows[1:])
    assert np.array_equal(np.concatenate(rows), whole.rows)


def test_looser_levels_save_iterations_and_keep_what_is_wanted(hanging):
    kernel, (q0, p0) = gauss_kernel(hanging, vi.gauss(8)), start()
    runs = [
        run_loop(kernel, q0, p0, np.zeros(0), t0=0.0, h=0.03, steps=40, save_every=40, level=level)
        for level in (0, 1e-9, 1e-5)
    ]
    assert runs[0].iterations > 1.3 * runs[1].iterations > 1.6 * runs[2].iterations
    errors = [np.abs(x.rows[-1, 0] - runs[0].rows[-1, 0]).max() for x in runs[1:]]
    assert errors[0] < 1e-6 and errors[0] < errors[1] < 1e-2


def test_steps_too_large_for_the_iteration_take_slopes_or_newtons_method():
    """Stiff springs between the links: plain iteration diverges; for an odd number of stages there
    are no slopes.
    """
    q, v = vi.coordinates(*(f"a{i}" for i in range(LINKS)))
    system = vi.System(q, v, kinetic(q, v, np.ones(LINKS)) - 1e5 * ca.sumsqr(q[1:] - q[:-1]))
    given = {"q0": np.linspace(0, 0.1, LINKS), "v0": np.full(LINKS, 0.1), "progress": False}
    how = given | {"h": 0.05, "steps": 3}
    for stages, status in ((2, DONE), (3, NOT_CONVERGED)):
        rule = vi.gauss(stages)
        kernel, motion = (
            gauss_kernel(system, rule),
            vi.simulate(system, rule, backend="interpreted", **how),
        )
        starts = motion.q[0], motion.p[0], np.zeros(0)
        large = run_loop(kernel, *starts, t0=0.0, h=0.05, steps=3)
        small = run_loop(kernel, *starts, t0=0.0, h=1e-4, steps=3)
        found = vi.simulate(system, rule, backend="compiled", **how)
        assert large.status == status and small.status == DONE
        assert np.abs(found.q - motion.q).max() < 1e-9


def test_stiff_dampers_of_a_long_chain_take_slopes_in_pieces_as_in_one():
    """Steps that slopes of the velocities that conjugate gradients find make contract: by the
    interpreted Newton method they are the same.
    """
    q, v = vi.coordinates(*(f"a{i}" for i in range(LINKS)))
    turns = v - ca.vertcat(0, v[:-1])
    damped = vi.System(
        q,
        v,
        kinetic(q, v, np.ones(LINKS)) + 9.81 * ca.sum1(ca.cos(q)),
        force=-200.0 * (turns - ca.vertcat(turns[1:], 0)),
    )
    rule, h, q0 = vi.gauss(4), 0.05, np.linspace(0.5, 0.9, LINKS)
    kernel = gauss_kernel(damped, rule)
    motion = vi.simulate(
        damped, rule, q0=q0, v0=np.zeros(LINKS), h=h, steps=12, backend="interpreted"
    )
    starts, options = (motion.q[0], motion.p[0], np.zeros(0)), {"t0": 0.0, "h": h}
    whole = run_loop(kernel, *starts, steps=12, **options)
    rows, carry = [whole.rows[:1]], None
    for first in (0, 4, 8):
        piece = run_loop(kernel, *starts, steps=4, first=first, carry=carry, **options)
        carry = piece.carry
        rows.append(piece.rows[1:])
    assert whole.status == DONE and whole.iterations < 12 * 25
    assert np.array_equal(np.concatenate(rows), whole.rows)
    assert np.abs(whole.rows[:, 0] - motion.q).max() < 1e-10 * np.abs(motion.q).max()


def test_a_step_of_its_own_takes_slopes_however_long_these_take():
    """Between nodes of a motion with stiff dampers: slopes of 132 unknowns are worth a hundred
    evaluations, and were not taken; such steps were interpreted, half a second each.
    """
    links = 66
    q, v = vi.coordinates(*(f"a{i}" for i in range(links)))
    turns = v - ca.vertcat(0, v[:-1])
    damped = vi.System(
        q,
        v,
        kinetic(q, v, np.ones(links)) / links**3 + 9.81 * ca.sum1(ca.cos(q)) / links**2,
        force=-0.01 * (turns - ca.vertcat(turns[1:], 0)),
    )
    rule = vi.gauss(8)
    motion = vi.simulate(damped, q0=np.linspace(0.5, 1, links), v0=np.zeros(links), duration=0.5)
    node = np.flatnonzero(np.diff(motion.t) > 0.004)[::4]
    assert len(node) > 5
    part = 0.7 * np.diff(motion.t)[node]
    begin = motion.q[node], motion.p[node], motion.c
    how = {"t": motion.t[node], "h": part, "u": np.empty((len(node), 0))}
    rows, good = take_parts(native_gauss(damped, rule), *begin, **how)
    assert good.mean() > 0.8
    between = motion.at((motion.t[node] + part)[good])
    assert np.abs(rows[good, 0] - between.q).max() < 1e-12
