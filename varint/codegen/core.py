"""The loops for scenes as data: built once with the package, else compiled once and kept."""

from __future__ import annotations

from collections.abc import Callable
from ctypes import c_char_p, c_int, c_int64, c_void_p
from functools import cache, lru_cache
from typing import Any, NamedTuple

from varint.codegen.arguments import c_source
from varint.codegen.built import built_library
from varint.codegen.cache import AS_WRITTEN, library, vector_length
from varint.numerics.progress import notice

_LEVELS = {8: "x86_64_v4", 4: "x86_64_v3", 2: "plain"}  # as setup.py calls them


class Loop(NamedTuple):
    """The entries of a loop: `run`, `parts`, the size of what it carries on, and `within_steps`
    where it has stages.
    """

    run: Callable[[bytes], int]
    parts: Callable[[bytes], int]
    carry_size: Callable[[int], int]
    within_steps: Callable[[bytes], int] | None = None


@lru_cache(maxsize=32)
def gauss_loop(lanes: int, vectors: int, form: int) -> Loop:
    """c/gauss.h for vectors of so many lanes, so many of them for the stages of a coordinate.

    Raises
    ------
    CompileError
        If it was not built with the package and there is no compiler.
    """
    names = f"{{name}}_{{level}}_{lanes}_{vectors}_{form}"
    return _loop_of_stages("core.c", names, {"LANES": lanes, "VECTORS": vectors, "FORM": form})


@lru_cache(maxsize=32)
def dense_loop(lanes: int, vectors: int) -> Loop:
    """The same for scenes of c/dense.c; raises CompileError as `gauss_loop` does."""
    names = f"{{name}}_dense_{{level}}_{lanes}_{vectors}"
    return _loop_of_stages("dense_core.c", names, {"LANES": lanes, "VECTORS": vectors})


@cache
def newton_loop() -> Loop:
    """c/newton.c; raises CompileError as `gauss_loop` does."""
    return _loop("newton_core.c", "{name}_newton_{level}", {})


@cache
def explicit_loop() -> Loop:
    """c/explicit.c; raises CompileError as `gauss_loop` does."""
    return _loop("explicit_core.c", "{name}_explicit_{level}", {})


@cache
def uniform_loop() -> Loop:
    """c/uniform_core.c; raises CompileError as `gauss_loop` does."""
    return _loop("uniform_core.c", "{name}_uniform_{level}", {})


@cache
def driven_entry() -> Callable[[bytes], int]:
    """c/driven_core.c; raises CompileError as `gauss_loop` does."""
    return _by_bytes("driven_core.c", "run", names="{name}_driven_{level}")[0]


@cache
def arrange_entry() -> Callable[[bytes], int]:
    """c/tape_core.c; raises CompileError as `gauss_loop` does."""
    return _by_bytes("tape_core.c", "arrange")[0]


@cache
def algebra_entries() -> tuple[Callable[[bytes], int], Callable[[bytes], int]]:
    """c/algebra_core.c, and what takes its graph; raises CompileError as `gauss_loop` does."""
    first, second = _by_bytes("algebra_core.c", "rearrange", "take_graph")
    return first, second


@cache
def dependence_entries() -> tuple[Callable[[bytes], int], Callable[[bytes], int]]:
    """c/dependence_core.c; raises CompileError as `gauss_loop` does."""
    first, second = _by_bytes("dependence_core.c", "fuse", "halve")
    return first, second


@cache
def contacts_entry() -> Callable[[bytes], int]:
    """c/contacts.c; raises CompileError as `gauss_loop` does."""
    return _by_bytes("contacts_core.c", "contacts")[0]


@cache
def sweep_entries() -> tuple[Callable, ...]:
    """Tangents and adjoints of c/sweep.c; raises CompileError as `gauss_loop` does."""
    return _entries("sweep_core.c", ("tangents", "adjoints"), "{name}_sweep_{level}", {})


@cache
def curvature_entry() -> Callable:
    """c/curvature.c; raises CompileError as `gauss_loop` does."""
    return _entries("sweep_core.c", ("curvatures",), "{name}_sweep_{level}", {})[0]


@cache
def explicit_sweep_entries() -> tuple[Callable, ...]:
    """Tangents and adjoints of c/sweep_explicit.c; raises CompileError as `gauss_loop` does."""
    names = "{name}_explicit_{level}"
    return _entries("sweep_explicit_core.c", ("tangents", "adjoints"), names, {})


@cache
def linear_sweep_entries() -> tuple[Callable, ...]:
    """Tangents and adjoints of c/sweep_linear.c; raises CompileError as `gauss_loop` does."""
    names = "{name}_linear_{level}"
    return _entries("sweep_linear_core.c", ("tangents", "adjoints"), names, {})


@cache
def rows_entry() -> Callable[[bytes], int]:
    """c/rows_core.c; raises CompileError as `gauss_loop` does."""
    return _by_bytes("rows_core.c", "rows")[0]


@cache
def crossings_entry() -> Callable[[bytes], int]:
    """c/crossings_core.c; raises CompileError as `gauss_loop` does."""
    return _by_bytes("crossings_core.c", "crossings")[0]


@cache
def switches_entry() -> Callable[[bytes], int]:
    """c/switches_core.c; raises CompileError as `gauss_loop` does."""
    return _by_bytes("switches_core.c", "switches")[0]


@cache
def few_steps_entry() -> Callable[[bytes], int]:
    """c/few_steps_core.c; raises CompileError as `gauss_loop` does."""
    return _by_bytes("few_steps_core.c", "few_steps")[0]


@cache
def held_entry() -> Callable[[bytes], int]:
    """c/held_core.c; raises CompileError as `gauss_loop` does."""
    return _by_bytes("held_core.c", "held")[0]


@cache
def times_entries() -> tuple[Callable[[bytes], int], ...]:
    """c/times_core.c: all at once; the shorter steps that go ahead, and where they arrive; where a
    clock shows the times. Raises
    CompileError as `gauss_loop` does.
    """
    return _by_bytes("times_core.c", "at_times", "go_ahead", "arrive", "at_clock")


@cache
def until_entry() -> Callable[[bytes], int]:
    """c/until_core.c; raises CompileError as `gauss_loop` does."""
    return _by_bytes("until_core.c", "until")[0]


@cache
def nearness_entries() -> tuple[Callable[[bytes], int], Callable[[bytes], int]]:
    """c/nearness_core.c; raises CompileError as `gauss_loop` does."""
    first, second = _by_bytes("nearness_core.c", "swing", "apart")
    return first, second


@cache
def look_ahead_entry() -> Callable[[bytes], int]:
    """c/look_ahead_core.c; raises CompileError as `gauss_loop` does."""
    return _by_bytes("look_ahead_core.c", "look_ahead")[0]


@cache
def two_runs_entries() -> tuple[Callable[[bytes], int], Callable[[bytes], int]]:
    """c/two_runs_core.c, and what takes its run; raises CompileError as `gauss_loop` does."""
    first, second = _by_bytes("two_runs_core.c", "two_runs", "take_run")
    return first, second


@cache
def varying_runs_entry() -> Callable[[bytes], int]:
    """c/varying_core.c; raises CompileError as `gauss_loop` does."""
    return _by_bytes("varying_core.c", "varying_runs")[0]


@cache
def refined_entry() -> Callable[[bytes], int]:
    """c/refined_core.c; raises CompileError as `gauss_loop` does."""
    return _by_bytes("refined_core.c", "refined")[0]


@lru_cache(maxsize=32)
def stage_sweep_entries(lanes: int, vectors: int) -> tuple[Callable, ...]:
    """Tangents and adjoints of c/sweep_gauss.c for vectors of so many lanes, so many of them for
    the stages of a coordinate; raises CompileError as `gauss_loop` does.
    """
    names = f"{{name}}_stages_{{level}}_{lanes}_{vectors}"
    shape = {"LANES": lanes, "VECTORS": vectors}
    return _entries("sweep_gauss_core.c", ("tangents", "adjoints"), names, shape)


def _by_bytes(
    file: str, *wanted: str, names: str = "{name}_{level}"
) -> tuple[Callable[[bytes], int], ...]:
    """Entries that are called with the bytes of what they are asked."""
    entries = _entries(file, wanted, names, {})
    for entry in entries:
        entry.argtypes, entry.restype = [c_char_p], c_int
    return entries


def _loop(file: str, names: str, defines: dict[str, int]) -> Loop:
    run, parts, size = _entries(file, ("run", "parts", "carry_size"), names, defines)
    for entry in (run, parts):
        entry.argtypes, entry.restype = [c_char_p], c_int
    size.argtypes, size.restype = [c_void_p], c_int64
    return Loop(run, parts, size)


def _loop_of_stages(file: str, names: str, shape: dict[str, int]) -> Loop:
    within_steps = _entries(file, ("within_steps",), names, shape)[0]
    return _loop(file, names, shape)._replace(within_steps=within_steps)


def _entries(
    file: str, wanted: tuple[str, ...], names: str, defines: dict[str, int]
) -> tuple[Any, ...]:
    level, built = _LEVELS[vector_length()], built_library()
    if built is None or not hasattr(built, names.format(name=wanted[0], level=level)):
        text = "".join(f"#define {key} {x}\n" for key, x in ({"LEVEL": level} | defines).items())
        with notice("compiling a loop for scenes as data (once; it is kept)"):
            built = library(text + c_source(file), AS_WRITTEN)
    return tuple(getattr(built, names.format(name=name, level=level)) for name in wanted)
