"""Graphs of operations of few kinds, equal ones once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, wraps
from itertools import chain, islice
from typing import Any, TypeVar

import numpy as np

from varint.codegen.arguments import c_source
from varint.errors import VarintError
from varint.scene.memory import per_scene
from varint.scene.system import System

Built = TypeVar("Built")

# as in c/graph.h
NUMBER, INPUT = -5, -4
_OTHERS = {NUMBER: "const", INPUT: "input", -3: "fma", -2: "fms", -1: "fnma"}
_WITHOUT_MEMORY, _TOO_MANY = 1, 2
TOO_MANY_VALUES = "too many values for a tape; use backend='compiled'"
LEAVES = frozenset(("const", "input"))  # computed from no other node
COMMUTATIVE = frozenset(("add", "mul", "fmin", "fmax", "hypot", "eq", "ne", "and", "or"))


class NotCompilable(VarintError):
    """The scene uses something that the compiled backend cannot express; the interpreted one
    can.
    """


def kernel_per_system(build: Callable[..., Built]) -> Callable[..., Built]:
    """`per_scene` that remembers refusals too: what was found too large is not examined again."""

    @wraps(build)
    def tried(system: System, *key: Any) -> tuple[Built | None, str]:
        try:
            return build(system, *key), ""
        except NotCompilable as refusal:
            return None, str(refusal)

    found = per_scene(tried)

    @wraps(build)
    def remembered(system: System, *key: Any) -> Built:
        kernel, refusal = found(system, *key)
        if kernel is None:
            raise NotCompilable(refusal)
        return kernel

    return remembered


@cache
def operation_codes() -> dict[str, int]:
    """Operations by name, as c/tape.h lists them."""
    text, names = c_source("tape.h").replace("\\\n", ""), list[str]()
    for name in ("OPERATIONS", "ONLY_ONCE", "ONLY_OFTEN"):
        calls = text.partition(f"#define {name}(")[2].partition("\n")[0].partition(")")[2]
        names += [call.partition("(")[2] for call in calls.split(")") if "(" in call]
    return {name: k for k, name in enumerate(["end", *names])}


@dataclass(frozen=True, eq=False)
class Graph:
    """Operations in the order of evaluation.

    Attributes
    ----------
    rows : array (…, 4) of int32
        What each node is: its kind and the nodes that it takes, -1 where there are none; see
        c/graph.h.
    numbers : array
        Values of those that are numbers.
    outputs : list of list of int
        The nodes of each output.
    """

    rows: np.ndarray
    numbers: np.ndarray
    outputs: list[list[int]]

    def __len__(self) -> int:
        return len(self.rows)

    @cached_property
    def nodes(self) -> list[tuple]:
        """Each node as (operation, operands…), ("input", argument, component) or ("const", x)."""
        names = {code: name for name, code in operation_codes().items()} | _OTHERS
        numbers = self.numbers.tolist()
        return [
            ("const", numbers[i]) if k == NUMBER else (names[k], *(j for j in taken if j >= 0))
            for i, (k, *taken) in enumerate(self.rows.tolist())
        ]


def operands(node: tuple) -> tuple[int, ...]:
    """The nodes that a node is computed from."""
    return () if node[0] in LEAVES else node[1:]


def flat(outputs: Sequence[Sequence[int]]) -> np.ndarray:
    """The nodes of all outputs, one after the other."""
    return np.fromiter(chain.from_iterable(outputs), np.int32)


def as_outputs(wanted: np.ndarray, sizes: Sequence[int]) -> list[list[int]]:
    """The opposite of `flat`, for outputs of these sizes."""
    nodes = iter(wanted.tolist())
    return [[*islice(nodes, size)] for size in sizes]


def raise_unless_arranged(answer: int, count: int) -> None:
    """What the functions of c/graph.h's graphs answer for so many operations."""
    if answer == _WITHOUT_MEMORY:
        raise MemoryError(f"no memory to arrange {count} operations")
    if answer == _TOO_MANY:
        raise NotCompilable(TOO_MANY_VALUES)
