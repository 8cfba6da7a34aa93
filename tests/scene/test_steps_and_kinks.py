"""Derivatives say nothing of steps and kinks: a scene with some is not what it seems by them."""

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.codegen.cache import compiler

BACKENDS = ("interpreted", "native", "compiled")


def scene(potential=0.0, force=None, extra=0.0, t=None):
    q, v = vi.coordinates("x", "y")
    terms = {"q": q, "v": v, "t": t}

    def of(make):
        return make(**terms) if callable(make) else make

    lagrangian = ca.sumsqr(v) / 2 - ca.sumsqr(q) / 2 - of(potential) + of(extra)
    given = {} if force is None else {"force": of(force)}
    return vi.System(q, v, lagrangian, t=t, **given)


NOT_LINEAR = {
    "kink": {"potential": lambda q, **_: ca.fabs(q[0])},
    "wall": {"potential": lambda q, **_: 3 * ca.fmax(q[0] - 0.3, 0) * (q[0] - 0.3)},
    "dry friction": {"force": lambda v, **_: -0.1 * ca.sign(v)},
    "step": {"force": lambda q, **_: ca.vertcat(ca.if_else(q[1] > 0.2, 1, 0), 0)},
    "stairs": {"force": lambda q, **_: ca.vertcat(0, ca.floor(4 * q[0]))},
}


@pytest.mark.parametrize("which", NOT_LINEAR)
def test_a_scene_with_steps_or_kinks_is_not_linear(which):
    assert scene().structure.linear
    assert not scene(**NOT_LINEAR[which]).structure.linear


def test_a_switch_in_time_leaves_a_scene_linear_in_its_coordinates():
    t = vi.time()
    switched = scene(force=lambda t, **_: ca.vertcat(ca.if_else(t > 1, 1, 0), 0), t=t)
    assert switched.structure.linear


def test_dry_friction_depends_on_the_velocity():
    rubbed = scene(force=lambda v, **_: -0.1 * ca.sign(v))
    assert rubbed.structure.force_on_velocity and not rubbed.structure.explicit


def test_a_momentum_with_a_step_is_not_linear_in_the_velocity():
    kicked = scene(extra=lambda v, **_: 0.1 * ca.fabs(v[0]))
    assert not kicked.structure.quadratic_kinetic
    turned = scene(extra=lambda q, v, **_: ca.sign(q[0]) * v[1])
    assert not turned.structure.separable


@pytest.mark.skipif(compiler() is None, reason="no C compiler")
@pytest.mark.parametrize("which", ["kink", "wall", "step"])
@pytest.mark.parametrize("rule", [vi.gauss(2), vi.lobatto(3)], ids=str)
def test_all_backends_move_alike_over_steps_and_kinks(which, rule):
    """Until a node lies so near the step that round-off decides on which side it is."""
    system = scene(**NOT_LINEAR[which])
    start = {"q0": [0.9, -0.4], "v0": [-0.3, 0.7], "h": 0.003, "steps": 600}
    motions = [vi.simulate(system, rule, **start, backend=backend) for backend in BACKENDS]
    assert motions[1].q.tobytes() == motions[2].q.tobytes()
    assert np.abs(motions[0].q - motions[1].q).max() < 1e-7
    straight = vi.simulate(scene(), rule, **start)
    assert np.abs(motions[0].q - straight.q).max() > 1e-2
