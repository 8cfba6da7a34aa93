"""An SX function as a graph of operations of few kinds, equal ones once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import wraps
from typing import Any, TypeVar

import casadi as ca

from varint.errors import VarintError
from varint.numerics.operations import operations_of
from varint.scene.memory import per_scene
from varint.scene.system import System

Built = TypeVar("Built")

MOST_PRODUCTS = 64  # largest whole power written as products


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


# elementary operations that have no form in C
_WITHOUT_C = {"erfinv"}
_OTHER_KINDS = {"assign", "lift", "sq", "twice", "inv", "pow", "constpow"}  # see _plain
LEAVES = frozenset(("const", "input"))  # computed from no other node
ONE = ("const", 1.0)
COMMUTATIVE = frozenset(("add", "mul", "fmin", "fmax", "hypot", "eq", "ne", "and", "or"))


@dataclass
class Graph:
    """Operations in the order of evaluation; node i is ``nodes[i] = (operation, operands...)``."""

    nodes: list[tuple] = field(default_factory=list)
    index: dict[tuple, int] = field(default_factory=dict)
    outputs: list[list[int]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.unit = self.index.get(ONE, -1)  # the number 1, once it is there

    def node(self, *key: Any) -> int:
        """The node (operation, operands...), equal ones once."""
        if key[0] in COMMUTATIVE and key[1] > key[2]:
            key = key[0], key[2], key[1]
        count = len(self.nodes)
        at = self.index.setdefault(key, count)
        if at == count:
            self.nodes.append(key)
            if key == ONE:
                self.unit = at
        return at

    def times(self, a: int, b: int) -> int:
        """a × b, where one of them may be the number 1."""
        if a == self.unit:
            return b
        return a if b == self.unit else self.node("mul", a, b)

    @property
    def one(self) -> int:
        return self.node(*ONE) if self.unit < 0 else self.unit


def operands(node: tuple) -> tuple[int, ...]:
    """The nodes that a node is computed from."""
    return () if node[0] in LEAVES else node[1:]


def raw_graph(f: ca.Function) -> Graph:
    """The function as a graph, operation by operation; outputs are dense."""
    try:
        operations = operations_of(f)
    except VarintError as error:
        raise NotCompilable(f"{error}; or use backend='interpreted'") from None
    graph = Graph()
    node = graph.node
    zero = node("const", 0.0)
    columns = [f.sparsity_in(k).find() for k in range(f.n_in())]
    at: list[int] = []
    for operation in operations.nodes:
        name, first = operation[0], operation[1]
        if name == "input":
            at.append(node("input", first, columns[first][operation[2]]))
        elif name == "const":
            at.append(node("const", first))
        elif name in _OTHER_KINDS:
            at.append(_plain(graph, name, [at[i] for i in operation[1:]]))
        elif name in _WITHOUT_C:
            raise NotCompilable(f"{name} has no form in C; use backend='interpreted'")
        elif len(operation) == 3:
            at.append(node(name, at[first], at[operation[2]]))
        else:
            at.append(node(name, at[first]))
    for output in operations.outputs:
        dense = [zero] * (output.shape[0] * output.shape[1])
        for place, i in zip(output.places, output.nodes, strict=True):
            dense[place] = at[i]
        graph.outputs.append(dense)
    return graph


def _plain(graph: Graph, name: str, a: list[int]) -> int:
    """One of CasADi's other kinds of operations in terms of fewer: no sq, inv, constpow; powers by
    multiplication.
    """
    if name in ("assign", "lift"):
        return a[0]
    if name == "sq":
        return graph.node("mul", a[0], a[0])
    if name == "twice":
        return graph.node("mul", graph.node("const", 2.0), a[0])
    if name == "inv":
        return graph.node("div", graph.node("const", 1.0), a[0])
    operation, *exponent = graph.nodes[a[1]]
    if (
        operation == "const"
        and abs(exponent[0]) <= MOST_PRODUCTS
        and (2 * exponent[0]).is_integer()
    ):
        return _plain_power(graph, a[0], exponent[0])
    return graph.node("pow", *a)


def _plain_power(graph: Graph, base: int, exponent: float) -> int:
    """base^exponent for multiples of 1/2."""
    if exponent < 0:
        return graph.node("div", graph.one, _plain_power(graph, base, -exponent))
    root = graph.node("sqrt", base) if exponent % 1 else graph.one
    return graph.times(root, whole_power(graph, base, int(exponent)))


def whole_power(graph: Graph, base: int, exponent: int) -> int:
    """base^exponent by repeated squaring."""
    result, square = graph.one, base
    while exponent:
        if exponent & 1:
            result = graph.times(result, square)
        exponent >>= 1
        square = graph.node("mul", square, square) if exponent else square
    return result
