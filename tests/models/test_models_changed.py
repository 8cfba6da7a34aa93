"""Models with other parameters and starts than their own: closed forms, invariants and claims hold
for these too, and the motion is long enough to show them.
"""

from __future__ import annotations

import inspect

import numpy as np
import pytest

import varint as vi
from varint import models

pytestmark = pytest.mark.filterwarnings("ignore:the Lagrangian is degenerate")
MOST_STEPS = 120
AT_MOST = {"restitution": 1.0, "e": 0.95}  # of bouncing balls and ellipses
FIXED = {
    "bouncing_ball": {"restitution": 1.0},
    "heavy_top_quaternion": {"inertia": (1, 1, 0.5)},
    "rosette": {"r0": 0.48, "thetadot0": 2.8},  # bound
}
LARGE = ("outer_solar_system", "toda_chain")  # nothing to draw, or too many to run
# as accurate as their rules, which are of second order, resolve these steps
COARSE = {"guiding_centre": 3e-2, "lotka_volterra": 1e-3, "knife_edge": 2e-4, "rolling_disc": 2e-4}


def changed(name: str, rng: np.random.Generator) -> models.Model:
    """The model with all of its numbers a little different."""
    arguments = {}
    for key, argument in inspect.signature(models.catalogue[name]).parameters.items():
        default, factor = argument.default, rng.uniform(0.75, 1.3)
        if isinstance(default, float):
            arguments[key] = min(float(default * factor), AT_MOST.get(key, np.inf))
        elif isinstance(default, tuple) and all(isinstance(x, float) for x in default):
            arguments[key] = tuple(
                x * y for x, y in zip(default, rng.uniform(0.75, 1.3, 9), strict=False)
            )
    try:
        return models.catalogue[name](**arguments | FIXED.get(name, {}))
    except vi.InputError:  # such as an orbit that is none: drawn anew
        return changed(name, rng)


def accurate(model: models.Model) -> vi.Trajectory:
    structure = model.system.structure
    if structure.degenerate or structure.nonholonomic:
        rule = None
    elif structure.constraints or structure.contacts:
        rule = vi.lobatto(6)
    else:
        many = structure.n > 6 and structure.explicit
        rule = vi.composition("kahan-li8") if many else vi.gauss(6)
    start = model.start
    steps = min(round(start.pop("duration") / model.h), MOST_STEPS)
    return vi.simulate(model.system, rule, **start, steps=steps)


@pytest.mark.parametrize("name", [name for name in models.catalogue if name not in LARGE])
def test_what_a_model_states_holds_for_other_parameters(name):
    rng = np.random.default_rng([2026, len(name)])
    for _ in range(2):
        model = changed(name, rng)
        motion, close = accurate(model), COARSE.get(name, 1e-9)
        assert abs(model.duration / model.h - round(model.duration / model.h)) < 1e-6
        for what, expression in model.invariants.items():
            values = motion.value(expression).reshape(len(motion), -1)
            size = max(np.abs(values).max(), 1e-3)
            assert np.abs(values - values[0]).max() <= close * size, what
        if model.exact is not None:
            q, v = model.exact(motion.t)
            assert np.abs(motion.q - q).max() <= close * np.abs(q).max()
            assert np.abs(q[0] - model.q0).max() <= 1e-12 * np.abs(q).max()
            assert np.abs(v[0] - model.v0).max() <= 1e-12 * max(np.abs(v).max(), 1.0)


def opening(motion: vi.Trajectory) -> float:
    """The time when a contact opens."""
    return next(event.time for event in motion.events if event.kind == "detachment")


RNG = np.random.default_rng(35)
LADDERS = [
    dict(
        theta0=float(RNG.uniform(0.3, 1.5)),
        mass=float(10 ** RNG.uniform(-1, 2)),
        length=float(10 ** RNG.uniform(-1, 1)),
        gravity=float(10 ** RNG.uniform(0, 1.3)),
    )
    for _ in range(5)
]


@pytest.mark.parametrize("changes", LADDERS)
def test_the_wall_lets_go_within_the_motion_of_any_ladder(changes):
    model = models.falling_ladder(**changes)
    motion = vi.simulate(model.system, **model.start)
    top = 2 / 3 * np.sin(changes["theta0"])
    angle = motion.at(opening(motion)).q.ravel()[2]
    assert np.sin(angle) == pytest.approx(top, rel=1e-6)


@pytest.mark.parametrize("theta0", [0.0, np.pi / 2, 2.0])
def test_a_ladder_that_does_not_slide_is_refused(theta0):
    with pytest.raises(vi.InputError, match="theta0 must lie between"):
        models.falling_ladder(theta0=theta0)


@pytest.mark.parametrize(("theta0", "gravity"), [(0.05, 9.81), (0.5, 1.62), (0.9, 25.0)])
def test_the_particle_leaves_any_sphere_within_its_motion(theta0, gravity):
    model = models.slide_off_sphere(theta0=theta0, gravity=gravity)
    motion = vi.simulate(model.system, **model.start)
    q = motion.at(opening(motion)).q.ravel()
    assert q[1] / np.hypot(*q) == pytest.approx(2 / 3 * np.cos(theta0), rel=1e-6)


@pytest.mark.parametrize(("part", "gravity"), [(2.2, 9.81), (4.0, 1.62), (4.8, 25.0)])
def test_the_string_goes_slack_within_its_motion(part, gravity):
    model = models.slack_string(speed=np.sqrt(part * gravity), gravity=gravity)
    motion = vi.simulate(model.system, **model.start)
    q = motion.at(opening(motion)).q.ravel()
    assert q[1] == pytest.approx(-(2 - part) / 3, rel=1e-6)


@pytest.mark.parametrize(("height", "gravity"), [(0.01, 9.81), (1.0, 1.62), (30.0, 25.0)])
def test_a_ball_bounces_as_often_from_any_height(height, gravity):
    own, other = models.bouncing_ball(), models.bouncing_ball(height=height, gravity=gravity)
    counts = [len(vi.simulate(m.system, **m.start).events) for m in (own, other)]
    assert counts[0] == counts[1] > 3


def test_an_asymmetric_top_is_no_symmetric_one():
    with pytest.raises(vi.InputError, match=r"symmetric top has inertia\[0\] = inertia\[1\]"):
        models.heavy_top_quaternion(inertia=(1.0, 1.1, 0.5))
