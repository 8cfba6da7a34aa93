"""Where a force bends sharply as a velocity passes zero, runs agree by luck: what such steps err by
is looked at.
"""

import warnings

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.codegen.two_runs import NOT_SHORT
from varint.integration import short_call, tolerance
from varint.integration.bent_steps import bends_with_velocity, made_by_bends
from varint.integration.error_scale import error_scales
from varint.integration.narrow_places import PARTS
from varint.integration.problem import RunOptions, Start, initial_value_problem
from varint.integration.short_refinement import by_short_refinement
from varint.integration.short_trials import by_short_trials
from varint.integration.small_motions import small_motions_at_start


def dragged_pendulum(c, a=0.0, w=1.0):
    q, v, t = *vi.coordinates("x"), vi.time()
    force = -c * v * ca.sqrt(v**2 + 0.01)
    if not a:
        return vi.System(q, v, v**2 / 2 + ca.cos(q), force=force)
    return vi.System(q, v, v**2 / 2 + ca.cos(q), force=force + a * ca.cos(w * t), t=t)


def rubbed_spring():
    q, v, t = *vi.coordinates("x"), vi.time()
    force = 0.6649430123012123 * ca.cos(0.46585324183221327 * t)
    force -= 0.2621061863737054 * ca.atan(v / 0.023129659809103493)
    return vi.System(q, v, (v**2 - q**2) / 2, force=force, t=t)


def rubbed_on_a_circle():
    q, v, t = *vi.coordinates("x", "y"), vi.time()
    force = -0.02697844557580499 * ca.atan(v / 0.15000025978574652)
    force += ca.vertcat(0.5785528359252713 * ca.cos(0.9739266675093674 * t), 0)
    return vi.System(q, v, ca.sumsqr(v) / 2 - q[1], force=force, constraint=ca.sumsqr(q) - 1, t=t)


def rubbed_on_a_sphere():
    q, v, t = *vi.coordinates("x", "y", "z"), vi.time()
    force = -0.043569890832032714 * ca.atan(v / 0.0957507952514259)
    force += ca.vertcat(0.692871957464827 * ca.cos(0.6265711818937726 * t), 0, 0)
    return vi.System(q, v, ca.sumsqr(v) / 2 - q[2], force=force, constraint=ca.sumsqr(q) - 1, t=t)


def on_a_circle(x, y, speed):
    return {"q0": [x, y], "v0": [-speed * y, speed * x]}


# scene, start, duration, what was asked; errors that were not told were so many times that
FOUND = {
    "53": (
        lambda: dragged_pendulum(0.32301877136234175, 0.812994366366649, 2.0644977323932387),
        {"q0": 1.11265703, "v0": 0.21041507},
        3.8507729572004505,
        1.2020147877927875e-11,
    ),
    "7.9": (
        lambda: dragged_pendulum(0.3104067587388378),
        {"q0": 1.50252523, "v0": -0.12478121},
        39.890132038957645,
        1.6166758061738297e-08,
    ),
    "7.2": (
        lambda: dragged_pendulum(0.09987049783239774),
        {"q0": 0.61350515, "v0": -0.96276676},
        13.296616343835918,
        3.1228958206985756e-08,
    ),
    "2.3": (
        rubbed_spring,
        {"q0": 0.41927643, "v0": 0.96672481},
        10.943817549224711,
        1.2819898053509517e-08,
    ),
    "1.8, held": (
        rubbed_on_a_circle,
        on_a_circle(0.22887815338120596, -0.9734550790379642, -0.9213769966270688),
        10.728563619244834,
        6.886352715315853e-07,
    ),
    "2.2, held": (
        rubbed_on_a_sphere,
        {
            "q0": [-0.5392569128873145, -0.28660534385197195, -0.7918707967709987],
            "v0": [0.24802208295738593, -0.9104006123560949, 0.16060455604939],
        },
        15.894598298283379,
        1.1153799283654252e-06,
    ),
}


@pytest.mark.parametrize("way", ["the core", "python", "the long way"])
@pytest.mark.parametrize("name", FOUND)
def test_luck_with_the_places_of_bends_is_not_counted_on(monkeypatch, name, way):
    build, start, duration, tol = FOUND[name]
    scene = build()
    more = {"scale": scales_known(scene, start, duration)} if way == "python" else {}
    if way == "the long way":
        monkeypatch.setattr(short_call, "proved_motion", lambda: lambda *_: NOT_SHORT)
        monkeypatch.setattr(tolerance, "by_short_trials", lambda *_: NOT_SHORT)
        monkeypatch.setattr(tolerance, "by_short_refinement", lambda *_: None)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        motion = vi.simulate(scene, **start, duration=duration, tol=tol, **more)
    error = error_of(scene, start, duration, motion)
    assert error <= motion.stats["error_estimate"] <= tol


@pytest.mark.parametrize("name", FOUND)
def test_steps_done_once_more_tell_of_a_run_that_errs_by_more_than_is_wanted(name):
    """Of few steps, so that errors are far above round-off."""
    build, start, duration, _ = FOUND[name]
    scene = build()
    for step in (0.55, 0.4, 0.3):
        steps = round(duration / step)
        rule = vi.lobatto(7) if "held" in name else vi.gauss(8)
        motion = vi.simulate(scene, rule, **start, duration=duration, steps=steps)
        rows = np.stack((motion.q, motion.p, motion.v), axis=1)
        scales, h = error_scales(scene, motion), motion.h

        def again(k, count, motion=motion, rule=rule, h=h):
            begin = {"q0": motion.q[k], "p0": motion.p[k], "t0": motion.t[k]}
            fine = vi.simulate(scene, rule, **begin, h=h / PARTS, steps=count)
            return np.stack((fine.q, fine.p), axis=1)

        wanted = 0.9 * error_of(scene, start, duration, motion)
        made = made_by_bends(scene, rule, rows, (0.0, h), motion.c, scales, wanted, again)
        assert made > wanted


def test_what_bends_with_velocities_is_told_by_what_forces_are_made_of():
    q, v, t = *vi.coordinates("x", "y"), vi.time()
    c = ca.SX.sym("c")

    def bends(force):
        kinetic = ca.sumsqr(v) / 2 - ca.sumsqr(q) / 2
        given = {"force": ca.densify(ca.vertcat(force, 0)), "params": {c: 1.0}}
        return bends_with_velocity(vi.System(q, v, kinetic, t=t, **given))

    assert not bends(-c * v[0])
    assert not bends(ca.sin(q[0]) * v[0] ** 3 * v[1] / (1 + q[0] ** 2) - ca.tanh(q[1] / c))
    assert not bends(ca.cos(t) + ca.exp(q[0]) * (c - v[1]) ** 2)
    for sharp in (
        ca.tanh(v[0] / c),
        v[0] * ca.norm_2(v),
        v[1] / (1 + v[0] ** 2),
        ca.cos(t) * ca.atan(v[1] - v[0]),
        (v[0] ** 2 + c) ** 1.5,
    ):
        assert bends(sharp)


@pytest.mark.parametrize("name", [x for x in FOUND if "held" not in x])
def test_the_core_decides_about_bends_as_python_does(name):
    build, start, duration, tol = FOUND[name]
    scene, rule, radians = build(), vi.gauss(8), duration
    asked = Start(np.atleast_1d(start["q0"]), np.atleast_1d(start["v0"]))
    problem = initial_value_problem(scene, rule, asked, RunOptions(steps=1, duration=duration))
    mass = small_motions_at_start(scene, problem.q0, problem.p0, problem.t0, problem.c)[1]
    for part in (1.0, 3.0, 0.1):
        turned, asked = (radians, radians), part * tol
        one = by_short_trials(scene, rule, problem, mass, asked, turned, "auto", 0.0)
        other = by_short_refinement(scene, rule, problem, asked, radians, None, "auto")
        assert (one.steps, one.runs, one.reached) == (other.steps, other.runs, other.reached)
        assert one.estimate == pytest.approx(other.estimate, rel=1e-9)
        assert one.motion.q.tobytes() == other.motion.q.tobytes()


def error_of(scene, start, duration, motion):
    steps = len(motion) - 1
    finer, rule = -(-4096 // steps), vi.lobatto(7) if scene.structure.constraints else vi.gauss(8)
    equal = motion.sizes is None
    fine = vi.simulate(
        scene,
        rule,
        **start,
        duration=duration,
        steps=finer * steps,
        save_every=finer if equal else 1,
    )
    q = fine.q if equal else fine.at(motion.t).q
    return float((np.abs(motion.q - q) / error_scales(scene, motion)).max())


def scales_known(scene, start, duration):
    """The core measures by its own alone."""
    motion = vi.simulate(scene, **start, duration=duration, steps=256)
    return error_scales(scene, motion)
