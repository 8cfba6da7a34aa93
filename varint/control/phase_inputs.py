"""What a phase is solved by: rule, duration, mesh and parameters, from what the user wrote."""

from __future__ import annotations

from typing import Any

import numpy as np

from varint.discrete.suitability import require_steppable
from varint.errors import InputError, parsed_or_refused
from varint.numerics.limits import check_memory
from varint.rules.rule import Rule, gauss, lobatto, midpoint, trapezoidal
from varint.scene.free import Free
from varint.scene.inputs import finite_array, float_of, positive_integer
from varint.scene.parameters import ParameterValues
from varint.scene.system import System, given_parameters, parameter_values


def rule_of(system: System, rule: Rule | None) -> Rule:
    """The rule, or the one that suits the scene."""
    structure = system.structure
    if structure.degenerate:
        raise InputError(
            "the Lagrangian is degenerate (∂²L/∂v² = 0): it has no end velocities to control"
        )
    if rule is None:
        if structure.nonholonomic:
            return trapezoidal() if structure.constraints else midpoint()
        return lobatto(3) if structure.constraints else gauss(2)
    if not isinstance(rule, Rule):
        raise InputError(f"rule must be a rule such as gauss(3), got {rule!r}")
    if not rule.points:
        raise InputError(
            f"{rule} is a composition with weights of both signs; optimal control takes gauss or "
            "lobatto"
        )
    require_steppable(system, rule)
    return rule


def duration_of(value: Any) -> tuple[float, float, float]:
    """Guess, lower and upper bound of the duration."""
    if value is None:
        raise InputError("give the duration: a number, or free(guess, lower, upper)")
    if isinstance(value, Free):
        if value.guess.shape != ():
            raise InputError(f"the duration is one number, got {value}")
        if not value.lower > 0:
            raise InputError(f"a free duration needs a positive lower bound, got {value}")
        return float(value.guess), float(value.lower), float(value.upper)
    duration = parsed_or_refused(
        lambda: float_of(value),
        lambda: f"the duration must be a number or free(guess, lower, upper), got {value!r}",
    )
    if not (np.isfinite(duration) and duration > 0):
        raise InputError(f"the duration must be positive and finite, got {value!r}")
    return duration, duration, duration


def mesh_of(steps: Any, mesh: Any) -> np.ndarray:
    """Ends of the steps as fractions of the duration."""
    if mesh is None:
        if isinstance(steps, int) and steps == 0:
            raise InputError("give steps, the number of steps of the path, such as 40, or a mesh")
        check_memory(
            f"a path of {positive_integer('steps', steps)} steps", steps, "take fewer steps"
        )
        return np.arange(steps + 1) / steps
    mesh = finite_array("mesh", mesh)
    if (
        mesh.ndim != 1
        or len(mesh) < 2
        or mesh[0] != 0
        or mesh[-1] != 1
        or not (np.diff(mesh) > 0).all()
    ):
        raise InputError("mesh must hold fractions of the duration that increase from 0 to 1")
    if positive_integer("steps", steps, 0) not in (0, len(mesh) - 1):
        raise InputError(f"steps={steps} but the mesh has {len(mesh) - 1}; give one of the two")
    return mesh


def parameters_of_phase(
    system: System, params: ParameterValues | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Guess, lower and upper bound of the parameter vector."""
    given = given_parameters(system, params)

    def part(name: str) -> np.ndarray:
        shapes = {k: np.shape(v) for k, v in system.defaults.items()}
        values = {
            k: np.broadcast_to(getattr(v, name), shapes.get(k, v.guess.shape))
            if isinstance(v, Free)
            else v
            for k, v in given.items()
        }
        return parameter_values(system, values)

    infinite = {k: v for k, v in given.items() if isinstance(v, Free)}
    if any(not np.isfinite([v.lower, v.upper]).all() for v in infinite.values()):
        raise InputError(f"free parameters need finite bounds, got {infinite}")
    return part("guess"), part("lower"), part("upper")
