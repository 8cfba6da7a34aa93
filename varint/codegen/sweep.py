"""Compiled loops over the steps of a run that carry tangents forwards and adjoints backwards."""

from __future__ import annotations

from collections.abc import Callable
from ctypes import POINTER, Structure, byref, c_int, c_int64, c_void_p
from dataclasses import dataclass

import casadi as ca
import numpy as np

from varint.codegen.arguments import c_source, c_table
from varint.codegen.band import Band, band
from varint.codegen.cache import library
from varint.codegen.emit import Emitted
from varint.codegen.graph import kernel_per_system
from varint.codegen.source import FAST_COMPILATION, LARGE_SOURCE, emit_functions
from varint.discrete.constrained_equations import CORRECTION_FLOOR
from varint.discrete.step_map import StepMap, path_guess, running, step_map
from varint.discrete.tolerances import LAST_CORRECTION
from varint.numerics.limits import STEP_ITERATIONS
from varint.rules.rule import Rule
from varint.scene.system import System

ROUNDED = 1e-14  # a correction this small, relative to the velocities, is round-off
LEAST_SPEED = 1e-3  # of the fastest coordinate: slower ones are judged by it
_INTEGERS = (
    "steps",
    "first",
    "columns",
    "every",
    "outer_moves",
    "control_column",
    "control_nodes",
    "smooth",
)
_ARRAYS = ("x", "v", "t", "h", "c", "u", "outer", "tangent", "out", "seeds", "loss", "failed")


class SweepArguments(Structure):
    """A piece of a run; see c/sweep.c."""

    _fields_ = [
        *((name, c_int64) for name in _INTEGERS),
        *((name, c_void_p) for name in _ARRAYS),
    ]


@dataclass(frozen=True, eq=False)
class SweepKernel:
    """Compiled loops of one system, one rule and one running loss.

    Attributes
    ----------
    tangents, adjoints : callable
        (arguments by name of c/sweep.c) → status.
    """

    tangents: Callable[[dict], int]
    adjoints: Callable[[dict], int]


@kernel_per_system
def sweep_kernel(system: System, rule: Rule, density: str | None = None) -> SweepKernel:
    """The compiled loops of any rule and scene without contacts; `density` is the running loss, the
    function (q, v, t, u, c) → ℓ, serialised.

    Raises
    ------
    NotCompilable
        If a step has too many operations.
    CompileError
        If there is no compiler or no safe cache folder.
    """
    loss = None if density is None else ca.Function.deserialize(density)
    s = step_map(system, rule)
    slopes = {
        "FY": ca.jacobian(s.left, s.y),
        "FX": ca.jacobian(s.left, s.state),
        "GY": ca.jacobian(s.after, s.y),
        "GX": ca.jacobian(s.after, s.state),
        "FE": ca.jacobian(s.left, s.outside),
        "GE": ca.jacobian(s.after, s.outside),
    }
    order = band(slopes["FY"].sparsity())
    functions = emit_functions(
        ca.vertcat(s.c, s.h), _functions(s, slopes, None if loss is None else running(s, loss))
    )
    defines = {
        "LANES": 1,
        "N": s.q.numel(),
        "NU": s.u.numel(),
        "CONTROLS": max(system.control.numel(), 1),
        "PARTS": len(s.parts),
        "PART": s.part.numel(),
        "Y": s.y.numel(),
        "POINTS": len(s.points),
        "ENDS": s.ends,
        "C": s.c.numel(),
        "E": s.outside.numel(),
        "LOSS": int(loss is not None),
        "BELOW": order.below,
        "REACH": order.reach,
        "BAND_SIZE": order.size,
        "LAST_CORRECTION": LAST_CORRECTION,
        "MOST_ITERATIONS": STEP_ITERATIONS,
        "ROUNDED": ROUNDED,
        "LEAST_SPEED": LEAST_SPEED,
        "ROUNDABLE": CORRECTION_FLOOR,
        "AFTER_W": 0,
        "DENSITY_W": 0,
    }
    defines |= {name: x.nnz() for name, x in slopes.items()}
    return compiled_sweep(functions, defines, _tables(s, slopes, order), "sweep.c")


def compiled_sweep(
    functions: dict[str, Emitted], defines: dict, tables: str, loop: str
) -> SweepKernel:
    """The loop (a C file) around the emitted functions."""
    defines = defines | {f"{name.upper()}_W": f.uniforms for name, f in functions.items()}
    length = sum(f.length for f in functions.values())
    source = FAST_COMPILATION if length > LARGE_SOURCE else ""
    source += "".join(f"#define {key} {value}\n" for key, value in defines.items())
    source += c_source("lanes.h") + c_source("run.h") + tables
    source += "\n".join(f.source for f in functions.values()) + c_source(loop)
    compiled = library(source)
    for entry in (compiled.tangents, compiled.adjoints):
        entry.argtypes, entry.restype = [POINTER(SweepArguments)], c_int
    return SweepKernel(
        lambda given: _call(compiled.tangents, given),
        lambda given: _call(compiled.adjoints, given),
    )


def _functions(
    s: StepMap, slopes: dict[str, ca.SX], loss: ca.SX | None
) -> dict[str, tuple[list[ca.SX], list[ca.SX]]]:
    mu, eta = ca.SX.sym("mu", s.after.numel()), ca.SX.sym("eta", s.y.numel())
    pulled = ca.dot(mu, s.after)
    if s.y.numel():
        pulled += ca.dot(eta, s.left)
        pull = [*s.inputs, mu, eta], [ca.gradient(pulled, s.outside)]
    else:
        pull = [*s.inputs, mu], [ca.gradient(pulled, x) for x in (s.outside, s.state)]
    blocks = [slopes[name].nz[:] for name in ("FY", "FX", "GY", "GX")]
    functions = {
        "blocks": (s.inputs, [s.left, *blocks]),
        "outside": (s.inputs, [slopes["FE"].nz[:], slopes["GE"].nz[:]]),
        "pull": pull,
    }
    if len(s.parts) > 1:
        functions["after"] = s.inputs, [s.after]
    if loss is not None:
        slopes_of_loss = [ca.densify(ca.gradient(loss, x)) for x in (s.y, s.state, s.outside)]
        functions["density"] = s.inputs, [loss, *slopes_of_loss]
    return functions


def _tables(s: StepMap, slopes: dict[str, ca.SX], order: Band) -> str:
    integers = {"PERM": order.order, "AT": order.places}
    for name, x in slopes.items():
        rows, columns = x.sparsity().get_triplet()
        integers |= {f"{name}_ROW": np.array(rows), f"{name}_COLUMN": np.array(columns)}
    numbers = {"PART_TABLE": s.parts, "HERMITE": path_guess(s.points)}
    return "".join(
        c_table("int", name, map(str, x.astype(int).tolist())) for name, x in integers.items()
    ) + "".join(
        c_table("double", name, map(float.hex, x.ravel().tolist())) for name, x in numbers.items()
    )


def _call(entry: Callable, given: dict) -> int:
    places = {
        name: given[name].ctypes.data if given.get(name) is not None else 0 for name in _ARRAYS
    }
    return entry(byref(SweepArguments(**{k: given[k] for k in _INTEGERS}, **places)))
