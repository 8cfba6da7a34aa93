"""Newton's method with nothing compiled for the scene."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np

from varint.codegen.arguments import c_source
from varint.codegen.block import Member, block_of
from varint.codegen.core import newton_loop
from varint.codegen.frozen import freezes
from varint.codegen.graph import NotCompilable, kernel_per_system, operations
from varint.codegen.kernel import Kernel
from varint.codegen.native import (
    MOST_OF_LOOPS,
    MOST_OPERATIONS,
    TOO_LARGE,
    kernel_on,
    tapes_of,
)
from varint.codegen.newton import newton_scheme
from varint.codegen.source import routines
from varint.codegen.tape import NOTHING_TO_DO
from varint.rules.rule import Rule
from varint.scene.system import System


@kernel_per_system
def native_newton(system: System, rule: Rule) -> Kernel:
    """The kernel of `newton_kernel` with the scene as data; raises as `native_gauss` does."""
    x = newton_scheme(system, rule)
    if x.by_nodes:
        raise NotCompilable(TOO_LARGE)
    functions = routines(x.constants, x.functions)
    tapes = tapes_of(functions, MOST_OF_LOOPS if freezes(system) else MOST_OPERATIONS)
    names = _names()
    members: list[Member] = [
        *(x.counts[name] for name in names["COUNTS"]),
        *(float(x.limits[name]) for name in names["LIMITS"]),
        *(x.places[name].astype(np.int32) for name in names["PLACES"]),
        *(x.tables[name].astype(float) for name in names["TABLES"]),
        *(tapes.get(name, NOTHING_TO_DO) for name in names["FUNCTIONS"]),
    ]
    first = next(iter(functions.values()))
    heads = x.about, system.q.numel(), system.control.numel(), len(rule.nodes)
    kernel = kernel_on((*heads, operations(*first)[0]), newton_loop(), block_of(members))
    return replace(kernel, opening=x.opening)


@cache
def _names() -> dict[str, list[str]]:
    """The members of the structure Scene of c/newton_scene.h, kind by kind."""
    text = c_source("newton_scene.h").replace("\\\n", "")
    found = re.findall(r"#define (\w+)\(DO\) (.*)", text)
    return {kind: re.findall(r"DO\((\w+)\)", names) for kind, names in found}
