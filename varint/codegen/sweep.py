"""Loops over the steps of a run that carry tangents forwards and adjoints backwards, and sum up
second derivatives: what they need of a scene, and their compiled form.
"""

from __future__ import annotations

from collections.abc import Callable
from ctypes import POINTER, Structure, byref, c_int, c_int64, c_void_p
from dataclasses import dataclass, replace
from functools import partial

import casadi as ca
import numpy as np

from varint.codegen.arguments import c_source, c_table
from varint.codegen.band import Band, band
from varint.codegen.cache import AS_WRITTEN, library
from varint.codegen.graph import kernel_per_system
from varint.codegen.routines import Routine, routines
from varint.codegen.source import FAST_COMPILATION, FEW_ROOTS, LARGE_SOURCE, emitted
from varint.discrete.constrained_equations import CORRECTION_FLOOR
from varint.discrete.step_map import StepMap, path_guess, running, step_map
from varint.discrete.tolerances import LAST_CORRECTION
from varint.numerics.limits import STEP_ITERATIONS
from varint.rules.rule import Rule
from varint.scene.system import System

ROUNDED = 1e-14  # a correction this small, relative to the velocities, is round-off
LEAST_SPEED = 1e-3  # of the fastest coordinate: slower ones are judged by it
ONE_BY_ONE = {"LANES": 1}  # shape of the vectors
_INTEGERS = (
    "steps",
    "first",
    "columns",
    "every",
    "outer_moves",
    "control_column",
    "control_nodes",
    "smooth",
    "x_apart",
    "v_apart",
)
_ARRAYS = (
    *("x", "v", "t", "h", "c", "u", "outer", "tangent", "out", "seeds", "loss", "failed"),
    *("along", "hessian"),
)


class SweepArguments(Structure):
    """A piece of a run; see c/sweep.c."""

    _fields_ = [
        *((name, c_int64) for name in _INTEGERS),
        *((name, c_void_p) for name in _ARRAYS),
        ("scene", c_void_p),
    ]


Sweep = Callable[[dict], int]


@dataclass(frozen=True, eq=False)
class SweepKernel:
    """Loops of one system, one rule and one running loss.

    Attributes
    ----------
    tangents, adjoints : callable
        (arguments by name of c/sweep.h) → status.
    """

    tangents: Sweep
    adjoints: Sweep


@dataclass(frozen=True, eq=False)
class SweepScheme:
    """What a loop needs of a scene and a rule, as C or as data.

    Attributes
    ----------
    functions : dict of Routine
        By the names in the loop.
    counts, limits : dict
        Numbers by their names there.
    places, tables : dict of array
        The same for arrays of whole and other numbers.
    """

    functions: dict[str, Routine]
    counts: dict[str, int]
    limits: dict[str, float]
    places: dict[str, np.ndarray]
    tables: dict[str, np.ndarray]


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
    return compiled_sweep(sweep_scheme(system, rule, density), ONE_BY_ONE, "sweep.c")


@kernel_per_system
def curvature_kernel(system: System, rule: Rule) -> Sweep:
    """The compiled loop of second derivatives; raises as `sweep_kernel` does."""
    loop = _library(curvature_scheme(system, rule), ONE_BY_ONE, "curvature.c")
    return entry_of(loop.curvatures)


def numbers_of(system: System, s: StepMap) -> dict[str, int]:
    """How many of what a step has, as the loops of all sweeps call them."""
    return {
        "N": s.q.numel(),
        "NU": s.u.numel(),
        "CONTROLS": max(system.control.numel(), 1),
        "PARTS": len(s.parts),
        "PART": s.part.numel(),
        "C": s.c.numel(),
        "E": s.outside.numel(),
    }


@kernel_per_system
def sweep_scheme(system: System, rule: Rule, density: str | None = None) -> SweepScheme:
    """Of c/sweep.c; raises NotCompilable."""
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
    expressions = _functions(s, slopes, None if loss is None else running(s, loss))
    counts = numbers_of(system, s) | {
        "Y": s.y.numel(),
        "POINTS": len(s.points),
        "ENDS": s.ends,
        "LOSS": int(loss is not None),
        "BELOW": order.below,
        "REACH": order.reach,
        "BAND_SIZE": order.size,
        "MOST_ITERATIONS": STEP_ITERATIONS,
    }
    counts |= {name: x.nnz() for name, x in slopes.items()}
    return SweepScheme(
        routines(ca.vertcat(s.c, s.h), expressions),
        counts,
        {
            "LAST_CORRECTION": LAST_CORRECTION,
            "ROUNDED": ROUNDED,
            "LEAST_SPEED": LEAST_SPEED,
            "ROUNDABLE": CORRECTION_FLOOR,
        },
        _places(slopes, order),
        {"PART_TABLE": s.parts, "HERMITE": path_guess(s.points)},
    )


@kernel_per_system
def curvature_scheme(system: System, rule: Rule) -> SweepScheme:
    """Of c/curvature.c; raises NotCompilable."""
    scheme, s = sweep_scheme(system, rule), step_map(system, rule)
    mu, eta = ca.SX.sym("mu", s.after.numel()), ca.SX.sym("eta", s.y.numel())
    twisted = ca.dot(mu, s.after) + ca.dot(eta, s.left)
    curved = ca.triu(ca.hessian(twisted, ca.vertcat(s.y, s.state, s.outside))[0])
    expression = {"curved": ([*s.inputs, mu, eta], [curved.nz[:]])}
    return replace(
        scheme,
        functions=scheme.functions | routines(ca.vertcat(s.c, s.h), expression),
        counts=scheme.counts | {"SS": curved.nnz()},
        places=scheme.places | _triplets("SS", curved),
    )


def compiled_sweep(scheme: SweepScheme, shape: dict[str, int], loop: str) -> SweepKernel:
    """The loop (a C file) around the emitted functions, with vectors of this shape."""
    compiled = _library(scheme, shape, loop)
    return SweepKernel(entry_of(compiled.tangents), entry_of(compiled.adjoints))


def entry_of(entry: Callable, scene: int = 0) -> Sweep:
    """How a loop is called; `scene` is where its operations are, if they are data."""
    entry.argtypes, entry.restype = [POINTER(SweepArguments)], c_int  # type: ignore[attr-defined]
    return partial(_call, entry, scene)


def _library(scheme: SweepScheme, shape: dict[str, int], loop: str):
    return library(sweep_source(scheme, shape, loop), AS_WRITTEN)


def sweep_source(scheme: SweepScheme, shape: dict[str, int], loop: str) -> str:
    """The text of the loop around the emitted functions."""
    functions = emitted(scheme.functions)
    heads = shape | scheme.counts | scheme.limits
    heads |= {f"{name.upper()}_W": f.uniforms for name, f in functions.items()}
    if sum(f.roots for f in functions.values()) > FEW_ROOTS:
        heads["MANY_ROOTS"] = 1
    length = sum(f.length for f in functions.values())
    source = FAST_COMPILATION if length > LARGE_SOURCE else ""
    source += "".join(f"#define {key} {value}\n" for key, value in heads.items())
    source += c_source("lanes.h") + c_source("run.h")
    for kind, tables, write in (("int", scheme.places, str), ("double", scheme.tables, float.hex)):
        source += "".join(
            c_table(kind, name, map(write, x.ravel().tolist())) for name, x in tables.items()
        )
    return source + "\n".join(f.source for f in functions.values()) + c_source(loop)


def _functions(
    s: StepMap, slopes: dict[str, ca.SX], loss: ca.SX | None
) -> dict[str, tuple[list[ca.SX], list[ca.SX]]]:
    """What a scene does not need has no outputs."""
    mu, eta, none = ca.SX.sym("mu", s.after.numel()), ca.SX.sym("eta", s.y.numel()), ca.SX(0, 1)
    pulled = ca.dot(mu, s.after)
    if s.y.numel():
        pulled += ca.dot(eta, s.left)
    of_state = none if s.y.numel() else ca.gradient(pulled, s.state)
    blocks = [slopes[name].nz[:] for name in ("FY", "FX", "GY", "GX")]
    of_loss = [none] * 4
    if loss is not None:
        of_loss = [loss, *(ca.gradient(loss, x) for x in (s.y, s.state, s.outside))]
    return {
        "blocks": (s.inputs, [s.left, *blocks]),
        "outside": (s.inputs, [slopes["FE"].nz[:], slopes["GE"].nz[:]]),
        "pull": ([*s.inputs, mu, eta], [ca.gradient(pulled, s.outside), of_state]),
        "after": (s.inputs, [s.after if len(s.parts) > 1 else none]),
        "density": (s.inputs, of_loss),
    }


def _places(slopes: dict[str, ca.SX], order: Band) -> dict[str, np.ndarray]:
    places = {"PERM": order.order, "AT": order.places}
    for name, x in slopes.items():
        places |= _triplets(name, x)
    return places


def _triplets(name: str, x: ca.SX) -> dict[str, np.ndarray]:
    """Rows and columns of the nonzeros."""
    rows, columns = x.sparsity().get_triplet()
    return {f"{name}_ROW": np.array(rows, int), f"{name}_COLUMN": np.array(columns, int)}


def _call(entry: Callable, scene: int, given: dict) -> int:
    places = {
        name: given[name].ctypes.data if given.get(name) is not None else 0 for name in _ARRAYS
    }
    integers = {k: given.get(k, 0) for k in _INTEGERS}
    return entry(byref(SweepArguments(**integers, **places, scene=scene)))
