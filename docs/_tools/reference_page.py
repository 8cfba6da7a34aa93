"""The reference page lists every public name, so that none is forgotten."""

from __future__ import annotations

import importlib
import inspect
from pathlib import Path

from state import write_if_changed

import varint as vi

ORDER = [
    ("Scenes", ["coordinates", "time", "Parameters", "System", "massless_limit"]),
    (
        "Rules",
        ["midpoint", "trapezoidal", "gauss", "lobatto", "composition", "Rule", "plan", "Plan"],
    ),
    ("Motion", ["simulate", "project", "step_function", "scale_function"]),
    ("Derivatives of whole runs", ["sensitivity", "gradient", "Gradient", "flow"]),
    (
        "Parameters from data",
        ["fit", "Measurement", "Experiment", "Fit", "Profile", "mhe", "Estimator", "Estimate"],
    ),
    ("Many at once", ["ensemble", "Ensemble"]),
    ("Paths", ["least_action", "paths", "geodesic", "free", "Free"]),
    (
        "Optimal control",
        [
            "optimal_control",
            "optimal_phases",
            "Phase",
            "Link",
            "refine",
            "multistart",
            "prepare",
            "Prepared",
            "soft",
            "Soft",
            "abs",
            "max",
            "control_rate",
            "reactions",
        ],
    ),
    (
        "How good an optimal control is",
        ["ControlSolution", "Sensitivity", "SecondOrder", "Contradiction", "live_plot"],
    ),
    ("Feedback", ["mpc", "Controller", "closed_loop", "lqr"]),
    ("Code that leaves", ["export"]),
    ("Results", ["Trajectory", "State", "load", "Sketch", "play"]),
    ("Symmetries", ["symmetries", "noether", "Symmetries", "Symmetry"]),
    ("Equations to read", ["equations", "Equations", "from_sympy"]),
]
ERRORS = ["VarintError", "InputError", "ConvergenceError", "SolverError"]
MODULES = ["course", "diagnostics", "models", "multibody", "orbits"]

# what other modules of the package use of a public class, and users need not know
INTERNAL = {
    "Equations": ("sections",),
    "ControlSolution": ("origin", "verdict", "to_arrays"),
    "Ensemble": ("k",),
    "Rule": (
        "points",
        "kicks",
        "drifts",
        "degree",
        "basis",
        "slopes",
        "extrapolation",
        "collocation",
    ),
    "Symmetry": ("size", "shared_by"),
    "System": ("default_vector",),
    "Trajectory": ("active_sets", "function_of", "evaluated", "sums"),
}


def write(path: Path) -> None:
    """Sections in reading order; public names without a place come under "More"."""
    placed = {name for _, names in ORDER for name in names} | {*ERRORS, *MODULES}
    sections = [*ORDER, ("More", sorted(set(dir(vi)) - placed)), ("Errors", ERRORS)]
    parts = ["Reference\n=========\n\nEvery public name, ``import varint as vi``.\n"]
    for title, names in sections:
        there = [name for name in names if name in dir(vi)]
        if there:
            parts.append(
                f"{title}\n{'-' * len(title)}\n\n"
                + "\n".join(_entry("varint", name) for name in there)
            )
    for module in MODULES:
        members = importlib.import_module(f"varint.{module}")
        parts.append(f"varint.{module}\n{'-' * (7 + len(module))}\n\n{inspect.getdoc(members)}\n\n")
        parts += [
            _entry(f"varint.{module}", name)
            for name in members.__all__
            if callable(getattr(members, name))
        ]
    write_if_changed(path, "\n".join(parts))


def _entry(module: str, name: str) -> str:
    what = getattr(importlib.import_module(module), name)
    if inspect.isclass(what):
        # fields of a named tuple that its section Attributes describes must not come twice
        described = "Attributes\n" in (inspect.getdoc(what) or "")
        fields = getattr(what, "_fields", ()) if described else ()
        hidden = ", ".join([*INTERNAL.get(name, ()), *fields])
        options = "   :members:\n" + (f"   :exclude-members: {hidden}\n" if hidden else "")
        return f".. autoclass:: {module}.{name}\n{options}"
    return f".. autofunction:: {module}.{name}\n"
