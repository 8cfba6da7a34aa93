"""What can be turned in a scene, and the motion that follows: the computation beneath the page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from varint.discrete.projection import project
from varint.drawing.sketch import Sketch, cartesian
from varint.errors import InputError
from varint.integration.simulate import simulate
from varint.models.model import Model
from varint.models.sketches import sketch as sketch_of
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.system import System, parameter_entries, parameter_values, parameters_by_name

WIDEST = 3.0  # a parameter is turned from a third of its size to so many times of it
WHOLE = 1e-9  # relative: a duration that is so nearly a number of steps is one
MOST_STEPS = 200_000  # of a motion that is made anew whenever something is turned


@dataclass(frozen=True)
class Knob:
    """A number that can be turned.

    Attributes
    ----------
    group : str
        ``"parameters"``, ``"start"``, ``"controls"`` or ``"time"``.
    name : str
        Such as ``length``, ``theta``, ``theta_dot``, ``duration``.
    value, low, high : float
        As it is, and from where to where it is usually turned; more is possible.
    """

    group: str
    name: str
    value: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Scene:
    """What is played with.

    Attributes
    ----------
    name, claim : str
        A title, and a sentence; empty where there is none.
    system, rule : System, Rule or None
    sketch : Sketch or None
        What is drawn; None where nothing has a place.
    h, t0 : float
        Step, and start time.
    knobs : tuple of Knob
        Parameters, coordinates, velocities, controls and duration, in this order.
    """

    name: str
    claim: str
    system: System
    rule: Rule | None
    sketch: Sketch | None
    h: float
    t0: float
    knobs: tuple[Knob, ...]


def scene_of(what: Model | Trajectory, sketch: Sketch | None = None) -> Scene:
    """The scene of a model, or of a motion with its own start, parameters and step.

    Raises
    ------
    InputError
        If it is neither, or its controls change with time, or its steps differ.
    """
    if isinstance(what, Model):
        return scene_of_start(what, None, what.start, sketch)
    if not isinstance(what, Trajectory):
        raise InputError(
            f"play takes a model or a motion, got {type(what).__name__}; a motion of your own "
            "scene is simulate(system, q0=…, v0=…, h=…, duration=…)"
        )
    if what.fictitious is not None or what.sizes is not None or not len(what.u):
        raise InputError("play takes a motion of equal steps: simulate it with h= and duration=")
    if (what.u != what.u[:1, :1]).any():
        raise InputError(
            "play takes a motion whose controls are constant, such as u=[0.0]; controls that "
            "change are a force of t in the scene"
        )
    s, v0 = what.system, None if what.system.structure.degenerate else what.v[0]
    found = sketch or cartesian(s.names, s.q)
    knobs = _knobs(s, what.c, what.q[0], v0, what.u[0, 0], what.duration)
    return Scene("", "", s, what.rule, found, what.h, float(what.t[0]), knobs)


def scene_of_start(
    model: Model, rule: Rule | None, start: Mapping[str, Any], sketch: Sketch | None = None
) -> Scene:
    """The scene of a model with the arguments of a run: ``h``, ``duration``, ``params`` if any."""
    s = model.system
    values, v0 = parameter_values(s, start.get("params")), start["v0"]
    controls = np.zeros(s.structure.controls)
    knobs = _knobs(
        s, values, start["q0"], None if s.structure.degenerate else v0, controls, start["duration"]
    )
    found = sketch or _sketch_of_model(model)
    return Scene(model.name, model.claim, s, rule, found, start["h"], 0.0, knobs)


def motion_of(scene: Scene, turned: Mapping[str, float]) -> Trajectory:
    """The motion with these numbers, by the names of knobs; the others are as they were.

    The start is brought onto the constraints where there are any, and the motion lasts a whole
    number of steps.

    Raises
    ------
    VarintError
        If there is no such motion; it says why.
    """
    s, n = scene.system, scene.system.structure.n
    known = {knob.name for knob in scene.knobs}
    if unknown := sorted(set(turned) - known):
        raise InputError(f"nothing to turn is called {unknown[0]!r}; there are {sorted(known)}")
    value = {knob.name: float(turned.get(knob.name, knob.value)) for knob in scene.knobs}
    groups: dict[str, list[float]] = {}
    for knob in scene.knobs:
        groups.setdefault(knob.group, []).append(value[knob.name])
    params = parameters_by_name(s, np.array(groups.get("parameters", [])))
    q0, v0 = np.array(groups["start"][:n]), np.array(groups["start"][n:])
    start: dict[str, Any] = dict(t0=scene.t0, params=params)
    if s.structure.constraints or s.structure.nonholonomic:
        q0, v0 = project(s, q0, v0, **start)
    if len(v0):
        start["v0"] = v0
    if "controls" in groups:
        start["u"] = np.array(groups["controls"])
    steps = max(int(np.ceil(value["duration"] / abs(scene.h) * (1 - WHOLE))), 1)
    if steps > MOST_STEPS:
        raise InputError(
            f"{steps} steps of {abs(scene.h):g} are too many to be made anew whenever something is "
            f"turned; take a duration of at most {MOST_STEPS * abs(scene.h):g}"
        )
    return simulate(s, scene.rule, q0=q0, h=scene.h, steps=steps, progress=False, **start)


def _knobs(
    system: System,
    values: np.ndarray,
    q0: np.ndarray,
    v0: np.ndarray | None,
    controls: np.ndarray,
    duration: float,
) -> tuple[Knob, ...]:
    found = [
        Knob("parameters", name, x, *_range(x))
        for name, x in zip(parameter_entries(system), map(float, values), strict=True)
    ]
    far = max(2 * np.abs(q0).max(initial=0.0), np.pi)  # half a turn of an angle at least
    for name, x in zip(system.names, map(float, q0), strict=True):
        found.append(Knob("start", name, x, x - far, x + far))
    fastest = max(np.abs(v0).max(initial=0.0), 1.0) if v0 is not None else 0.0
    for name, x in zip(system.names, [] if v0 is None else map(float, v0), strict=False):
        found.append(Knob("start", f"{name}_dot", x, x - 2 * fastest, x + 2 * fastest))
    for name, x in zip(system.control_names, map(float, controls), strict=True):
        size = max(2 * abs(x), 1.0)
        found.append(Knob("controls", name, x, -size, size))
    lasts = abs(float(duration))
    return (*found, Knob("time", "duration", lasts, lasts / 10, 3 * lasts))


def _range(x: float) -> tuple[float, float]:
    """From where to where a parameter is turned: its sign is kept, for a mass has one."""
    if x == 0:
        return -1.0, 1.0
    ends = sorted((x / WIDEST, x * WIDEST))
    return ends[0], ends[1]


def _sketch_of_model(model: Model) -> Sketch | None:
    """The model's own sketch; None where it has no place to show."""
    try:
        return sketch_of(model)
    except InputError:
        return None
