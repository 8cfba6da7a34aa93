"""What the words of the command line mean: numbers, files, rules, models and their settings."""

from __future__ import annotations

import argparse
import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np

import varint as vi
from varint.models import ControlModel, Model

FAMILIES: dict[str, Callable[..., vi.Rule]] = {
    "gauss": vi.gauss,
    "lobatto": vi.lobatto,
    "midpoint": vi.midpoint,
    "trapezoidal": vi.trapezoidal,
}
WHOLE = 1e-9  # relative: a duration that is so nearly a number of steps is one


def positive(text: str) -> float:
    """A positive number."""
    try:
        number = float(text)
    except ValueError:
        number = np.nan
    if not 0 < number < np.inf:
        raise argparse.ArgumentTypeError(f"{text} is no positive number")
    return number


def file(*kinds: str) -> Callable[[str], Path]:
    """Reads the name of a file of one of these kinds, before anything runs."""

    def path(text: str) -> Path:
        if Path(text).suffix.lower() not in kinds:
            raise argparse.ArgumentTypeError(f"{text} must end in {' or '.join(kinds)}")
        return Path(text)

    return path


def rule(text: str) -> vi.Rule:
    """The rule of a name such as ``gauss(3)``, ``midpoint`` or ``blanes-moan6``."""
    match = re.fullmatch(r"(\w+)(?:\((\d*)\))?", text.strip())
    try:
        if match and match[1] in FAMILIES:
            return FAMILIES[match[1]](*([int(match[2])] if match[2] else []))
        return vi.composition(re.sub(r"^composition\(['\"]?(.*?)['\"]?\)$", r"\1", text.strip()))
    except TypeError:
        raise argparse.ArgumentTypeError(
            f"{text}: write gauss(2), lobatto(3), midpoint or trapezoidal"
        ) from None
    except vi.VarintError as error:
        raise argparse.ArgumentTypeError(
            f"{text} is no rule: {error}; or gauss(2), lobatto(3), midpoint"
        ) from None


def setting(text: str) -> tuple[str, Any]:
    """Name and value of ``length=2``, ``m=1,2.5`` or ``steps=40``."""
    name, equals, value = (part.strip() for part in text.partition("="))
    if not (equals and name.isidentifier()):
        raise argparse.ArgumentTypeError(f"{text}: write NAME=NUMBER or NAME=NUMBER,NUMBER,…")
    try:
        numbers = [float(part) for part in value.split(",")]
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text}: {value!r} is no number") from None
    return name, tuple(numbers) if "," in value else numbers[0]


def chosen(asked: argparse.Namespace) -> tuple[Model | ControlModel, dict[str, Any]]:
    """The model of this name with the settings and the start that were asked for, and values of
    the parameters that its factory does not take.

    Raises
    ------
    InputError
        If there is none, or it has no such argument, parameter or coordinate; with those it has.
    """
    factory = _factory(asked.model)
    known = inspect.signature(factory).parameters
    asked_for = dict(asked.set or [])
    arguments = {
        name: _like(known[name].default, name, value)
        for name, value in asked_for.items()
        if name in known
    }
    model = factory(**arguments)
    params = {name: value for name, value in asked_for.items() if name not in known}
    defaults = {} if isinstance(model, ControlModel) else model.system.defaults
    unknown = [name for name in params if name not in defaults]
    if unknown:
        every = list(dict.fromkeys([*known, *defaults]))
        raise vi.InputError(f"{asked.model} has no {', '.join(unknown)}; it has {', '.join(every)}")
    if isinstance(model, ControlModel):
        if asked.start:
            raise vi.InputError(f"{asked.model} comes with its own start: leave out --start")
        return model, {}
    if params:
        model = replace(model, exact=None)  # which is known for the model's own parameters
    return _started(model, dict(asked.start or [])), params


def _factory(name: str) -> Callable[..., Model | ControlModel]:
    every: dict[str, Callable[..., Any]] = vi.models.catalogue | vi.models.control_catalogue
    if name in every:
        return every[name]
    near = get_close_matches(name, every, 3, 0.4) or list(every)[:3]
    raise vi.InputError(
        f"unknown model {name!r}; did you mean {', '.join(near)}? `python -m varint list` has all"
    )


def _like(default: Any, name: str, value: Any) -> Any:
    """The value in the form of the argument's default: a number, a whole number, several."""
    if callable(default) or isinstance(default, Mapping):
        raise vi.InputError(f"{name} is no number; set it in Python")
    if isinstance(default, int):
        if isinstance(value, tuple) or value != int(value):
            raise vi.InputError(f"{name} is a whole number such as {default}, got {value}")
        return int(value)
    if isinstance(default, (tuple, list, np.ndarray)) != isinstance(value, tuple) and default:
        kind = f"{len(default)} numbers" if isinstance(default, (tuple, list)) else "one number"
        raise vi.InputError(f"{name} is {kind} such as {default}, got {value}")
    return value


def _started(model: Model, start: Mapping[str, Any]) -> Model:
    """The model with another start: q0 and v0, or single coordinates x and velocities x_dot."""
    if not start:
        return model
    names = model.system.names
    vectors: dict[str, Any] = {"q0": model.q0.copy(), "v0": model.v0.copy()}
    for name, value in start.items():
        place, of = ("v0", name.removesuffix("_dot")) if name.endswith("_dot") else ("q0", name)
        if name in vectors:
            vectors[name] = np.atleast_1d(np.array(value, dtype=float))
        elif of in names and not isinstance(value, tuple):
            vectors[place][names.index(of)] = value
        else:
            raise vi.InputError(
                f"{name}={value} is no start of {model.name}: give q0 or v0 with {len(names)} "
                f"numbers, or one of {', '.join(names[:6])}{', …' if len(names) > 6 else ''} "
                "(velocities with _dot)"
            )
    return replace(model, **vectors, exact=None)


def simulated(asked: argparse.Namespace, what: str) -> tuple[Model, dict[str, Any]]:
    """A model that is simulated, not solved, and its start."""
    model, params = chosen(asked)
    if isinstance(model, ControlModel):
        raise vi.InputError(
            f"{asked.model} is an optimal control problem, which `{what}` is not for; use "
            f"`run {asked.model}`"
        )
    return model, start_of(model, params, asked)


def start_of(model: Model, params: dict[str, Any], asked: argparse.Namespace) -> dict[str, Any]:
    """The model's start with the step and time span that were asked for.

    The motion ends when it was asked to: where steps do not fit, they are made a little shorter,
    and that is said.
    """
    start = dict(model.start) | ({"params": params} if params else {})
    h = getattr(asked, "h", None) or start["h"]
    duration = asked.duration or start["duration"]
    if h > duration * (1 + WHOLE):
        raise vi.InputError(f"a step of {h:g} is longer than the motion, {duration:g}; change --h")
    steps = int(np.ceil(duration / h * (1 - WHOLE)))
    fitting = duration / steps
    if abs(fitting - h) > WHOLE * h:
        print(f"steps of {h:g} do not fit a duration of {duration:g}: {steps} of {fitting:.6g}")
    return start | {"h": fitting, "duration": duration}
