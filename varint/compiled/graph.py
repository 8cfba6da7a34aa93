"""An SX function as a graph of operations of few kinds, equal ones once."""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca

from varint.errors import VarintError

MOST_PRODUCTS = 64  # largest whole power written as products


class NotCompilable(VarintError):
    """The scene uses something that the compiled backend cannot express; the interpreted one can."""


_NAMES = """
    add sub mul div neg exp log pow constpow sqrt sq twice sin cos tan asin acos atan lt le eq ne not and or floor ceil
    fmod fabs sign copysign if_else_zero erf fmin fmax inv sinh cosh tanh asinh acosh atanh atan2 assign lift log1p
    expm1 hypot remainder
"""
_OPERATIONS = {getattr(ca, f"OP_{name.upper()}"): name for name in _NAMES.split()}
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


def read(f: ca.Function) -> Graph:
    """The function as a graph, operation by operation; outputs are dense."""
    graph = Graph()
    zero = graph.node("const", 0.0)
    graph.outputs = [[zero] * f.numel_out(k) for k in range(f.n_out())]
    rows = [f.sparsity_out(k).find() for k in range(f.n_out())]
    columns = [f.sparsity_in(k).find() for k in range(f.n_in())]
    work: dict[int, int] = {}
    for k in range(f.n_instructions()):
        code, out, source = f.instruction_id(k), f.instruction_output(k), f.instruction_input(k)
        if code == ca.OP_CONST:
            work[out[0]] = graph.node("const", f.instruction_constant(k))
        elif code == ca.OP_INPUT:
            work[out[0]] = graph.node("input", source[0], columns[source[0]][source[1]])
        elif code == ca.OP_OUTPUT:
            graph.outputs[out[0]][rows[out[0]][out[1]]] = work[source[0]]
        elif code in _OPERATIONS:
            work[out[0]] = _plain(graph, _OPERATIONS[code], [work[i] for i in source])
        else:
            raise NotCompilable(f"operation {code} of the expression graph has no form in C; use backend='interpreted'")
    return graph


def _plain(graph: Graph, name: str, a: list[int]) -> int:
    """One operation of CasADi's in terms of fewer kinds: no sq, inv, constpow; powers by multiplication."""
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
        if operation == "const" and abs(exponent[0]) <= MOST_PRODUCTS and (2 * exponent[0]).is_integer():
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

    The first half has the outputs but the last, and one more: what the second takes from it. The second half has the
    inputs (`argument`, taken from the first half, `constants`) and the last output. What depends on the constants
    alone is in both halves.
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
