"""An SX function as a graph of operations, with common factors, powers and divisions arranged for speed.

Equal operations appear once, numerical factors move to the outside of products, whole and half powers become
multiplications and square roots, and divisions by powers of one expression share one reciprocal. Each rewriting is
exact or costs one rounding.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from fractions import Fraction

import casadi as ca

from varint.errors import VarintError

MOST_PRODUCTS = 64  # largest whole power written as products
LONGEST_CHAIN = 6  # terms of a sum added one after the other; longer sums are split, for latency


class NotCompilable(VarintError):
    """The scene uses something that the compiled backend cannot express; the interpreted one can."""


_NAMES = """
    add sub mul div neg exp log pow constpow sqrt sq twice sin cos tan asin acos atan lt le eq ne not and or floor ceil
    fmod fabs sign copysign if_else_zero erf fmin fmax inv sinh cosh tanh asinh acosh atanh atan2 assign lift log1p
    expm1 hypot remainder
"""
_OPERATIONS = {getattr(ca, f"OP_{name.upper()}"): name for name in _NAMES.split()}
_COMMUTATIVE = {"add", "mul", "fmin", "fmax", "hypot", "eq", "ne", "and", "or"}
Term = tuple[float, int]  # factor × node
Sum = tuple[Term, ...]


@dataclass
class Graph:
    """Operations in the order of evaluation; node i is ``nodes[i] = (operation, operands...)``."""

    nodes: list[tuple] = field(default_factory=list)
    index: dict[tuple, int] = field(default_factory=dict)
    outputs: list[list[int]] = field(default_factory=list)

    def node(self, operation: str, *operands) -> int:
        if operation in _COMMUTATIVE:
            operands = tuple(sorted(operands))
        key = (operation, *operands)
        if key not in self.index:
            self.index[key] = len(self.nodes)
            self.nodes.append(key)
        return self.index[key]


def operands(node: tuple) -> tuple[int, ...]:
    """The nodes that a node is computed from."""
    return () if node[0] in ("const", "input") else node[1:]


def graph_of(f: ca.Function) -> Graph:
    """The operations of the SX function f, rearranged for speed; outputs are dense."""
    raw = _read(f)
    live = needed(raw)
    plan = _shared_divisions(raw, live, f.n_in() - 1)
    graph = Graph()
    sums: dict[int, Sum] = {}
    uses = Counter(j for i in live for j in operands(raw.nodes[i]))
    uses.update(i for output in raw.outputs for i in output)
    for i in sorted(live):
        sums[i] = _rewritten(graph, raw, plan, sums, i, uses[i] > 1)
    graph.outputs = [[_node(graph, sums[i]) for i in output] for output in raw.outputs]
    return graph


def _read(f: ca.Function) -> Graph:
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
            return _power(graph, a[0], exponent[0])
        name = "pow"
    return graph.node(name, *a)


def _power(graph: Graph, base: int, exponent: float) -> int:
    if exponent < 0:
        return graph.node("div", graph.node("const", 1.0), _power(graph, base, -exponent))
    whole = int(exponent)
    result = graph.node("sqrt", base) if whole != exponent else None
    square = base
    while whole:
        if whole & 1:
            result = square if result is None else graph.node("mul", result, square)
        whole >>= 1
        square = graph.node("mul", square, square) if whole else square
    return graph.node("const", 1.0) if result is None else result


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


@dataclass
class _Divisions:
    """How to divide: denominators as factor × base^exponent, and which reciprocal serves each base."""

    monomials: list[tuple[float, int | None, Fraction]]
    reciprocal: dict[int, str]  # base: "root" for 1/√base, "inverse" for 1/base


def _shared_divisions(raw: Graph, live: set[int], last: int) -> _Divisions:
    monomials: list[tuple[float, int | None, Fraction]] = []
    uniform = uniform_nodes(raw, last)
    for i, node in enumerate(raw.nodes):
        monomials.append(_monomial(monomials, i, node))
    exponents: dict[int, list[Fraction]] = {}
    for i in sorted(live):
        if raw.nodes[i][0] == "div":
            _, base, exponent = monomials[raw.nodes[i][2]]
            if base is not None and exponent > 0:
                exponents.setdefault(base, []).append(exponent)
    reciprocal = {}
    for base, found in exponents.items():
        if any(e.denominator == 2 for e in found):
            reciprocal[base] = "root"
        elif len(found) > 1 or uniform[base]:
            reciprocal[base] = "inverse"
    return _Divisions(monomials, reciprocal)


def uniform_nodes(graph: Graph, argument: int) -> list[bool]:
    """Which nodes depend on nothing but the input `argument`."""
    uniform: list[bool] = []
    for node in graph.nodes:
        free = node[0] == "const" or (node[0] == "input" and node[1] == argument)
        uniform.append(free if node[0] in ("const", "input") else all(uniform[j] for j in node[1:]))
    return uniform


def _monomial(known, i: int, node: tuple) -> tuple[float, int | None, Fraction]:
    """Node i as factor × base^exponent (base None: a number)."""
    atom = (1.0, i, Fraction(1))
    name, *rest = node
    if name == "const":
        return (rest[0], None, Fraction(0))
    if name == "neg":
        c, base, e = known[rest[0]]
        return (-c, base, e)
    if name == "sqrt":
        c, base, e = known[rest[0]]
        return (1.0, base, e / 2) if base is not None and c == 1 and e == 1 else atom
    if name == "mul":
        (c, base, e), (d, other, g) = known[rest[0]], known[rest[1]]
        if base is None or other is None or base == other:
            return (c * d, other if base is None else base, e + g)
    return atom


def _rewritten(graph: Graph, raw: Graph, plan: _Divisions, sums: dict[int, Sum], i: int, shared: bool) -> Sum:
    """Node i of the raw graph as a sum of terms; one that several nodes use is made a node of its own."""
    name, *rest = raw.nodes[i]
    if name == "const":
        return ((rest[0], graph.node("const", 1.0)),)
    if name == "input":
        return ((1.0, graph.node(*raw.nodes[i])),)
    if name == "neg":
        return _scaled(sums[rest[0]], -1.0)
    if name == "mul":
        result = _product(graph, sums[rest[0]], sums[rest[1]])
    elif name in ("add", "sub"):
        result = _merged(sums[rest[0]] + _scaled(sums[rest[1]], 1.0 if name == "add" else -1.0))
    elif name == "div":
        result = _quotient(graph, plan, sums, rest[0], rest[1])
    elif name == "sqrt" and plan.reciprocal.get(rest[0]) == "root":
        base = _node(graph, sums[rest[0]])
        result = ((1.0, graph.node("mul", base, graph.node("rsqrt", base))),)
    else:
        result = ((1.0, graph.node(name, *(_node(graph, sums[j]) for j in rest))),)
    return (_term(graph, result),) if shared and len(result) > 1 else result


def _scaled(terms: Sum, factor: float) -> Sum:
    return tuple((factor * c, a) for c, a in terms)


def _merged(terms: Sum) -> Sum:
    """Like terms added up."""
    factors: dict[int, float] = {}
    for c, a in terms:
        factors[a] = factors.get(a, 0.0) + c
    kept = tuple((c, a) for a, c in factors.items() if c)
    return kept or ((0.0, terms[0][1]),)


def _term(graph: Graph, terms: Sum) -> Term:
    """A sum as factor × node; a factor common to all terms stays outside."""
    if len(terms) == 1:
        return terms[0]
    size = abs(terms[0][0])
    if all(abs(c) == size for c, _ in terms) and not any(_is_one(graph, a) for _, a in terms):
        return (size, _added(graph, [(c / size, a) for c, a in terms]))
    return (1.0, _added(graph, list(terms)))


def _added(graph: Graph, terms: list[Term]) -> int:
    """The sum as a node: terms without a factor first, so that each further one is a fused multiply-add."""
    if len(terms) > LONGEST_CHAIN:
        half = len(terms) // 2
        return graph.node("add", _added(graph, terms[:half]), _added(graph, terms[half:]))
    first, *others = sorted(terms, key=lambda term: (term[0] != 1.0, term[0] != -1.0, term[0] < 0))
    total = _single(graph, first)
    for c, a in others:
        total = graph.node("sub" if c < 0 else "add", total, _single(graph, (abs(c), a)))
    return total


def _single(graph: Graph, term: Term) -> int:
    c, a = term
    if _is_one(graph, a) or not c:
        return graph.node("const", c)
    if c == 1:
        return a
    return graph.node("neg", a) if c == -1 else graph.node("mul", graph.node("const", c), a)


def _node(graph: Graph, terms: Sum) -> int:
    return _single(graph, _term(graph, terms))


def _is_one(graph: Graph, a: int) -> bool:
    return graph.nodes[a] == ("const", 1.0)


def _constant(graph: Graph, terms: Sum) -> bool:
    return len(terms) == 1 and _is_one(graph, terms[0][1])


def _product(graph: Graph, x: Sum, y: Sum) -> Sum:
    if _constant(graph, x):
        return _scaled(y, x[0][0])
    if _constant(graph, y):
        return _scaled(x, y[0][0])
    (c, a), (d, b) = _term(graph, x), _term(graph, y)
    return ((c * d, graph.node("mul", a, b)),)


def _quotient(graph: Graph, plan: _Divisions, sums: dict[int, Sum], top: int, bottom: int) -> Sum:
    factor, base, exponent = plan.monomials[bottom]
    if base is None and factor:
        return _scaled(sums[top], 1 / factor)
    kind = plan.reciprocal.get(base) if base is not None and factor and exponent > 0 else None
    if base is None or kind is None:
        (c, a), (d, b) = _term(graph, sums[top]), _term(graph, sums[bottom])
        if not d or _is_one(graph, b):
            return ((1.0, graph.node("div", _node(graph, sums[top]), _node(graph, sums[bottom]))),)
        return ((c / d, graph.node("div", a, b)),)
    inner = _node(graph, sums[base])
    if kind == "root":
        reciprocal, times = graph.node("rsqrt", inner), int(2 * exponent)
    else:
        reciprocal, times = graph.node("div", graph.node("const", 1.0), inner), int(exponent)
    return _product(graph, sums[top], ((1 / factor, _power(graph, reciprocal, times)),))
