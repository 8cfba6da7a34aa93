"""The functions of a scene that a loop needs, and the C source around them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from ctypes import CDLL, addressof, c_char, c_char_p, c_int, c_int64
from dataclasses import replace
from time import sleep
from typing import TYPE_CHECKING, NamedTuple

import casadi as ca
import numpy as np

from varint.codegen.arguments import c_source
from varint.codegen.arranged import WRITTEN_OUT
from varint.codegen.cache import WHEREVER, begin_compilation, finished, in_cache, library
from varint.codegen.graph import NotCompilable
from varint.codegen.kernel import Kernel
from varint.codegen.routines import Expressions, Routine, routines
from varint.scene.system import System

if TYPE_CHECKING:
    from varint.codegen.emit import Emitted

FEW_ROOTS = 2  # up to so many square roots a call their latency counts, beyond their number
BRIEFLY = 0.002  # seconds from one look at a compiler to the next
MOST_STATEMENTS = 50_000  # in C: more takes the compiler minutes
# statements from which on the compiler's time matters more than the last tenth of the run's
LARGE_SOURCE = 20_000
FAST_COMPILATION = '#pragma GCC optimize ("O1")\n'
# for long functions of single numbers without loops: passes that find next to nothing in these take
# half of the compiler's time, and what it takes for the best use of registers is not seen in a run
STRAIGHT_LINES = """#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC optimize ("O1", "tree-slp-vectorize", "no-tree-pta", "no-tree-dse", \
    "no-tree-dominator-opts", "no-ipa-modref", "no-ipa-pure-const", "no-ipa-reference", \
    "no-ipa-profile", "no-dce", "no-dse", "no-cprop-registers", "no-tree-reassoc", \
    "no-tree-bit-ccp", "no-tree-fre", "ira-algorithm=priority")
#endif
"""
# angles whose sines are asked for by one call: where unknowns are few, two are faster one by one
FEWEST, FEWEST_OF_FEW = 2, 3
# functions of Newton's method that are called at a start, every RESIZED steps of c/newton.c, or
# where folds are near; steps in parts prepare for each part
RARE_IN_PARTS = frozenset({"sized", "independence"})
RARE = RARE_IN_PARTS | {"shared", "units", "slope", "affine"}
AT_STAGES = ("rhs", "kick", "drift", "inertia")


class Source(NamedTuple):
    """A loop in C and what the kernel around it is made of.

    Attributes
    ----------
    text, contraction : str
        For `library`.
    kernel : Kernel
        Without its entries.
    loop : str
        The C source of what depends on the size of the scene alone, where this is compiled apart.
    """

    text: str
    contraction: str
    kernel: Kernel
    loop: str = ""

    @property
    def texts(self) -> list[str]:
        """What is compiled, each of them apart."""
        return [self.loop, self.text] if self.loop else [self.text]


def source_of(
    about: str,
    system: System,
    nodes: int,
    functions: dict[str, Emitted],
    defines: dict,
    data: str,
    *loop: str,
    opening: Callable[..., np.ndarray] | None = None,
    rows: int = 0,
    contraction: str = WHEREVER,
    apart: str = "",
    straight: bool = False,
) -> Source:
    """The loop (C files) around the emitted functions, the right-hand side first; `apart` is what
    of it is compiled apart; `straight`: what is not has no loops that take time.
    """
    heads = {"N": system.q.numel(), "NU": system.control.numel(), **defines}
    heads |= {f"{name.upper()}_W": f.uniforms for name, f in functions.items()}
    if sum(f.roots for f in functions.values()) > FEW_ROOTS:
        heads["MANY_ROOTS"] = 1
    large = sum(f.length for f in functions.values()) > LARGE_SOURCE
    source = FAST_COMPILATION if large else STRAIGHT_LINES if straight else ""
    source += c_head(heads, data) + "\n".join(f.source for f in functions.values())
    source += "".join(map(c_source, loop if apart else (*loop, "parts.c")))
    kernel = Kernel(
        about,
        system.q.numel(),
        system.control.numel(),
        nodes,
        next(iter(functions.values())).operations,
        opening=opening,
        rows=rows,
    )
    return Source(source, contraction, kernel, apart)


def c_head(heads: Mapping[str, object], data: str) -> str:
    """What stands before the functions in C."""
    defines = "".join(f"#define {key} {value}\n" for key, value in heads.items())
    return defines + "".join(map(c_source, ("lanes.h", "run.h"))) + data


def compiled(source: Source) -> Kernel:
    """The kernel, compiled where it is not in the cache; raises CompileError."""
    loop, *others = libraries(source.texts, source.contraction)
    for entry in (loop.run, loop.parts):
        entry.argtypes, entry.restype = [c_char_p], c_int
    size = c_int64.in_dll(loop, "carry_size").value
    scene = _scene_in(others[0]) if others else 0
    kernel = replace(source.kernel, entry=loop.run, parts=loop.parts, carry_size=size, scene=scene)
    return replace(kernel, within_steps=getattr(loop, "within_steps", None))


def libraries(sources: Sequence[str], contraction: str = WHEREVER) -> list[CDLL]:
    """`library` of each; those that are to be compiled are so at the same time."""
    missing = [x for x in sources if not in_cache(x, contraction)]
    beside = [begin_compilation(x, contraction) for x in missing[1:]]
    if missing:
        library(missing[0], contraction)
    for work in beside:
        while work and not finished(work):
            sleep(BRIEFLY)
    return [library(x, contraction) for x in sources]


def _scene_in(compiled: CDLL) -> int:
    """The address of what a loop calls."""
    return addressof(c_char.in_dll(compiled, "scene"))


def emitted_together(
    functions: Mapping[str, Routine], parameters: int, few: bool, in_parts: bool
) -> dict[str, Emitted]:
    """The same as C at single points, and as "shared" what they all take that is prepared, behind
    so many parameters; `few` unknowns, and whether steps are `in_parts`: see FEWEST and RARE.
    """
    from varint.codegen.emit import Emitted, emit_graph  # not all that is run is compiled
    from varint.codegen.instructions import as_instructions
    from varint.codegen.prepared import PreparedNumbers

    fewest = FEWEST_OF_FEW if few else FEWEST
    rare = RARE_IN_PARTS if in_parts else RARE
    shared = PreparedNumbers(parameters)

    def written(name: str, f: Routine) -> Emitted:
        found = None if few else as_instructions(name, f.graph, f.last, shared)
        return found or emit_graph(
            name, f.graph, f.last, shared=shared, fewest=fewest, rare=name in rare
        )

    result = {name: written(name, f) for name, f in functions.items()}
    length = len(shared.statements)
    prepare = shared.source("shared", "shared" in rare)
    result["shared"] = Emitted(prepare, len(shared), 0, 0, length, length)
    return _affordable(result)


def emitted(
    functions: Mapping[str, Routine], stride: str = "1", written_out: int = WRITTEN_OUT
) -> dict[str, Emitted]:
    """The same as C. Those that are evaluated at the stages, not at nodes, have components so many
    vectors apart.
    """
    from varint.codegen.emit import emit_graph

    result = {
        name: emit_graph(name, f.graph, f.last, stride if name in AT_STAGES else "1", written_out)
        for name, f in functions.items()
    }
    return _affordable(result)


def _affordable(functions: dict[str, Emitted]) -> dict[str, Emitted]:
    """Themselves; raises NotCompilable where one of them is too long."""
    for name, f in functions.items():
        if f.length > MOST_STATEMENTS:
            raise NotCompilable(
                f"{name} has {f.length} statements; {MOST_STATEMENTS} compile in reasonable time; "
                "use "
                'backend="interpreted", or fewer coordinates'
            )
    return functions


def emit_functions(
    constants: ca.SX, expressions: Expressions, written_out: int = WRITTEN_OUT
) -> dict[str, Emitted]:
    """`routines` as C."""
    return emitted(routines(constants, expressions, written_out), written_out=written_out)
