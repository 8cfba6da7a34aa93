"""A solver for an optimal control problem: in its units, and for Fatrop as a chain of stages."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from varint.control.problem import ControlProblem
from varint.control.scaling import choose_scales
from varint.nlp.arrangement import Arrangement, plain_order
from varint.nlp.solver import Solver, build_solver, require_solver


def build_control_solver(
    problem: ControlProblem,
    x: np.ndarray,
    name: str = "ipopt",
    options: Mapping[str, Any] | None = None,
) -> Solver:
    """Build the solver `name` for a problem, scaled about the point x; options go to
    `casadi.nlpsol` as they are.
    """
    require_solver(name)
    order = _stages(problem) if name == "fatrop" else plain_order(problem.nlp)
    return build_solver(problem.nlp, name, options, choose_scales(problem, x), order)


def _stages(problem: ControlProblem) -> Arrangement:
    from varint.control.stages import arrange_as_stages

    return arrange_as_stages(problem)
