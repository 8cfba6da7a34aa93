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
COMMUTATIVE = {"add", "mul", "fmin", "fmax", "hypot", "eq", "ne", "and", "or"}


@dataclass
class Graph:
    """Operations in the order of evaluation; node i is ``nodes[i] = (operation, operands...)``."""

    nodes: list[tuple] = field(default_factory=list)
    index: dict[tuple, int] = field(default_factory=dict)
    outputs: list[list[int]] = field(default_factory=list)

    def node(self, operation: str, *operands) -> int:
        if operation in COMMUTATIVE:
            operands = tuple(sorted(operands))
        key = (operation, *operands)
        if key not in self.index:
            self.index[key] = len(self.nodes)
            self.nodes.append(key)
        return self.index[key]

    def times(self, a: int, b: int) -> int:
        """a × b, where one of them may be the number 1."""
        if self.is_one(a):
            return b
        return a if self.is_one(b) else self.node("mul", a, b)

    def is_one(self, a: int) -> bool:
        return self.nodes[a] == ("const", 1.0)

    @property
    def one(self) -> int:
        return self.node("const", 1.0)


def operands(node: tuple) -> tuple[int, ...]:
    """The nodes that a node is computed from."""
    return () if node[0] in ("const", "input") else node[1:]


def raw_graph(f: ca.Function) -> Graph:
    """The function as a graph, operation by operation; outputs are dense."""
    try:
        operations = operations_of(f)
    except VarintError as error:
        raise NotCompilable(f"{error}; or use backend='interpreted'") from None
    graph = Graph()
    zero = graph.node("const", 0.0)
    columns = [f.sparsity_in(k).find() for k in range(f.n_in())]
    at: list[int] = []
    for name, *taken in operations.nodes:
        if name == "input":
            at.append(graph.node("input", taken[0], columns[taken[0]][taken[1]]))
        elif name == "const":
            at.append(graph.node("const", *taken))
        elif name in _WITHOUT_C:
            raise NotCompilable(f"{name} has no form in C; use backend='interpreted'")
        else:
            at.append(_plain(graph, name, [at[i] for i in taken]))
    for output in operations.outputs:
        dense = [zero] * (output.shape[0] * output.shape[1])
        for place, node in zip(output.places, output.nodes, strict=True):
            dense[place] = at[node]
        graph.outputs.append(dense)
    return graph


def _plain(graph: Graph, name: str, a: list[int]) -> int:
    """One operation of CasADi's in terms of fewer kinds: no sq, inv, constpow; powers by
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
    if name in ("pow", "constpow"):
        operation, *exponent = graph.nodes[a[1]]
        if (
            operation == "const"
            and abs(exponent[0]) <= MOST_PRODUCTS
            and (2 * exponent[0]).is_integer()
        ):
            return _plain_power(graph, a[0], exponent[0])
        name = "pow"
    return graph.node(name, *a)


def _plain_power(graph: Graph, base: int, exponent: float) -> int:
    """base^exponent for multiples of 1/2."""
    if exponent < 0:
        return graph.node("div", graph.one, _plain_power(graph, base, -exponent))
    root = graph.node("sqrt", base) if exponent % 1 else graph.one
    return graph.times(root, whole_power(graph, base, int(exponent)))


def needed(graph: Graph) -> set[int]:
    """The nodes that the outputs depend on."""
    live: set[int] = set()
    waiting = [i for output in graph.outputs for i in output]
    while waiting:
        i = waiting.pop()
        if i not in live:
            live.add(i)
            waiting += operands(graph.nodes[i])
    return live


def uniform_nodes(graph: Graph, argument: int) -> list[bool]:
    """Which nodes depend on nothing but the input `argument`."""
    uniform: list[bool] = []
    for node in graph.nodes:
        free = node[0] == "const" or (node[0] == "input" and node[1] == argument)
        uniform.append(free if node[0] in ("const", "input") else all(uniform[j] for j in node[1:]))
    return uniform


def operations(graph: Graph, argument: int) -> tuple[int, int]:
    """How many nodes depend on more than the input `argument`, and the square roots among them."""
    uniform = uniform_nodes(graph, argument)
    varying = [graph.nodes[i][0] for i in needed(graph) if not uniform[i]]
    return len(varying), sum(name in ("rsqrt", "sqrt") for name in varying)


def fused(graph: Graph, argument: int) -> Graph:
    """The same with products in sums as one operation that rounds once: ``fma(a, b, c) = a·b + c``,
    ``fms`` = a·b − c, ``fnma`` = c − a·b.

    What depends on nothing but the input `argument` is left as it is.
    """
    uniform, live = uniform_nodes(graph, argument), sorted(needed(graph))
    elsewhere = {i for output in graph.outputs for i in output}  # used not in sums alone
    for i in live:
        if graph.nodes[i][0] not in ("add", "sub"):
            elsewhere.update(operands(graph.nodes[i]))
    result, places = Graph(), dict[int, int]()
    for i in live:
        name, *rest = graph.nodes[i]
        if name in ("const", "input"):
            places[i] = result.node(name, *rest)
            continue
        products = [
            k
            for k in range(len(rest) if name in ("add", "sub") else 0)
            if graph.nodes[rest[k]][0] == "mul" and not uniform[rest[k]]
        ]
        if products:
            k = max(products, key=lambda k: (rest[k] not in elsewhere, k))
            a, b = (places[j] for j in graph.nodes[rest[k]][1:])
            kind = "fma" if name == "add" else ("fms", "fnma")[k]
            places[i] = result.node(kind, a, b, places[rest[1 - k]])
        else:
            places[i] = result.node(name, *(places[j] for j in rest))
    result.outputs = [[places[i] for i in output] for output in graph.outputs]
    return result


def whole_power(graph: Graph, base: int, exponent: int) -> int:
    """base^exponent by repeated squaring."""
    result, square = graph.one, base
    while exponent:
        if exponent & 1:
            result = graph.times(result, square)
        exponent >>= 1
        square = graph.node("mul", square, square) if exponent else square
    return result


def halves(graph: Graph, argument: int, constants: int) -> tuple[Graph, Graph]:
    """What does not depend on the input `argument`, and what follows once it is known.

    The first half has the outputs but the last, and one more: what the second takes from it. The
    second half has the inputs (`argument`, taken from the first half, `constants`) and the last
    output. What depends on the constants alone is in both halves.
    """
    late = [False] * len(graph.nodes)
    for i, node in enumerate(graph.nodes):
        late[i] = node[:2] == ("input", argument) or any(late[j] for j in operands(node))
    uniform = uniform_nodes(graph, constants)
    wanted: set[int] = set()
    waiting = list(graph.outputs[-1])
    while waiting:
        i = waiting.pop()
        if i not in wanted:
            wanted.add(i)
            waiting += operands(graph.nodes[i]) if late[i] or uniform[i] else ()
    second, taken, places = Graph(), list[int](), dict[int, int]()
    for i in sorted(wanted):
        name, *rest = graph.nodes[i]
        if name == "const":
            places[i] = second.node(name, *rest)
        elif not (late[i] or uniform[i]):
            places[i] = second.node("input", 1, len(taken))
            taken.append(i)
        elif name == "input":
            places[i] = second.node(name, 0 if late[i] else 2, rest[1])
        else:
            places[i] = second.node(name, *(places[j] for j in rest))
    second.outputs = [[places[i] for i in graph.outputs[-1]]]
    return Graph(graph.nodes, graph.index, [*graph.outputs[:-1], taken]), second


def sine_and_cosine(
    graph: Graph, live: list[int], uniform: list[bool]
) -> dict[int, tuple[int, int]]:
    """For each node that belongs to a sine and cosine of one angle: the pair at the first, (0,
    0) at the second.
    """
    found: dict[int, dict[str, int]] = {}
    for i in live:
        if graph.nodes[i][0] in ("sin", "cos") and not uniform[i]:
            found.setdefault(graph.nodes[i][1], {})[graph.nodes[i][0]] = i
    pairs = {}
    for both in found.values():
        if len(both) == 2:
            pairs[min(both.values())] = (both["sin"], both["cos"])
            pairs[max(both.values())] = (0, 0)
    return pairs
