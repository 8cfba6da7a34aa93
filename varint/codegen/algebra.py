"""The operations of an SX function arranged for speed.

Equal operations appear once; numerical factors and powers move to the outside of products, where
those of equal bases merge and cancel; whole, half and quarter powers become multiplications and
square roots, and divisions by powers of one expression share one reciprocal. Each rewriting is
exact or costs one rounding.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca

from varint.codegen.dependence import needed, uniform_nodes
from varint.codegen.graph import Graph, operands, raw_graph, whole_power

FEW_TERMS = 8  # of a sum that is looked into, since some may cancel where it is used
LONGEST_CHAIN = 6  # terms of a sum added one after the other; longer sums are split, for latency
Powers = tuple[tuple[int, int], ...]  # nodes and their exponents, in quarters
Term = tuple[float, int, Powers]  # factor × node × powers
Sum = tuple[Term, ...]


def graph_of(f: ca.Function, constants: int = -1) -> Graph:
    """The operations of the SX function f, rearranged for speed; outputs are dense.

    The argument with the index `constants` is the same all the time.
    """
    raw = raw_graph(f)
    live = needed(raw)
    r = _rewriting(raw, live, constants % f.n_in())
    uses = [0] * len(raw.nodes)
    for taken in [*(operands(raw.nodes[i]) for i in live), *raw.outputs]:
        for i in taken:
            uses[i] += 1
    for i in live:
        r.sums[i] = _kept(r, i, _rewritten(r, i), uses[i] > 1)
    r.graph.outputs = [[_node(r, r.sums[i]) for i in output] for output in raw.outputs]
    return r.graph


@dataclass
class _Rewriting:
    """A raw graph and what becomes of it, node by node.

    `bases` are the raw nodes whose powers are gathered, those below a root or a division, and how
    their powers are written: by 1/√base ("root"), by 1/base ("inverse"), else by a division each;
    `kinds` the same for new nodes. Of the new nodes, `constant` are the same all the time, and
    `parts` are the terms of a short sum.
    """

    raw: Graph
    bases: dict[int, str]
    uniform: list[bool]
    graph: Graph = field(default_factory=Graph)
    sums: dict[int, Sum] = field(default_factory=dict)
    kinds: dict[int, str] = field(default_factory=dict)
    constant: set[int] = field(default_factory=set)
    parts: dict[int, Sum] = field(default_factory=dict)


def _rewriting(raw: Graph, live: list[int], constants: int) -> _Rewriting:
    monomials: list[tuple[float, int | None, int]] = []
    uniform = uniform_nodes(raw, constants)
    for i, node in enumerate(raw.nodes):
        monomials.append(_monomial(monomials, uniform, i, node))
    divided: dict[int, list[int]] = {}
    rooted: set[int] = set()
    for i in live:
        name, *rest = raw.nodes[i]
        if name in ("div", "sqrt"):
            _, base, exponent = monomials[rest[-1]]
            if base is not None and exponent > 0 and name == "div":
                divided.setdefault(base, []).append(exponent)
            elif base is not None:
                rooted.add(base)
    bases = dict.fromkeys(rooted, "")
    for base, found in divided.items():
        if any(e % 4 for e in found):
            bases[base] = "root"
        else:
            bases[base] = "inverse" if len(found) > 1 or uniform[base] else ""
    return _Rewriting(raw, bases, uniform)


def _monomial(known, uniform: list[bool], i: int, node: tuple) -> tuple[float, int | None, int]:
    """Node i as factor × base^exponent (base None: a number), but for factors that are the same
    all the time.
    """
    atom = (1.0, i, 4)
    name, *rest = node
    if name == "const":
        return (rest[0], None, 0)
    if name == "neg":
        c, base, e = known[rest[0]]
        return (-c, base, e)
    if name == "sqrt":
        c, base, e = known[rest[0]]
        return (1.0, base, e // 2) if base is not None and c == 1 and _has_root(e) else atom
    if name == "mul":
        (c, base, e), (d, other, g) = known[rest[0]], known[rest[1]]
        if base is None or other is None or base == other:
            return (c * d, other if base is None else base, e + g)
        if uniform[rest[0]] != uniform[rest[1]]:
            return (d, other, g) if uniform[rest[0]] else (c, base, e)
    return atom


def _has_root(quarters: int) -> bool:
    """Is √(x^e) = x^(e/2) wherever x^e ≥ 0, and a power of quarters?"""
    return quarters % 2 == 0 and quarters % 8 != 0


def _kept(r: _Rewriting, i: int, terms: Sum, shared: bool) -> Sum:
    """What the users of node i see: the power of a base or of what is the same all the time, a
    sum that many use.
    """
    if r.uniform[i] or i in r.bases:
        c, a, powers = _term(r, terms)
        if r.graph.is_one(a):
            return ((c, a, powers),)
        if r.uniform[i]:
            r.constant.add(a)
        r.kinds.setdefault(a, "inverse" if r.uniform[i] else r.bases[i])
        return ((c, r.graph.one, _joined(powers, ((a, 4),))),)
    if not shared:
        return terms
    c, a, powers = _term(r, terms)
    if not powers:
        return ((c, a, powers),)
    lasting = tuple(
        power for power in powers if r.kinds[power[0]] == "root" or power[0] in r.constant
    )
    # each of the users would multiply by the other powers again
    if not r.graph.is_one(a) and lasting != powers:
        a = _times(r, a, _joined(powers, _inverse(lasting)))
        powers = lasting
    return ((c, a, powers),)


def _expanded(r: _Rewriting, terms: Sum) -> Sum:
    """The sum with the terms of the sums in it: some may cancel."""
    return tuple(
        (c * d, b, _joined(powers, more))
        for c, a, powers in terms
        for d, b, more in r.parts.get(a, ((1.0, a, ()),))
    )


def _rewritten(r: _Rewriting, i: int) -> Sum:
    """Node i of the raw graph as a sum of terms."""
    name, *rest = r.raw.nodes[i]
    if name == "const":
        return ((rest[0], r.graph.one, ()),)
    if name == "input":
        return ((1.0, r.graph.node(*r.raw.nodes[i]), ()),)
    x = [r.sums[j] for j in rest]
    if name == "neg":
        return _scaled(x[0], -1.0)
    if name == "mul":
        return _product(r, *x)
    if name in ("add", "sub"):
        sign = 1.0 if name == "add" else -1.0
        short = _merged(x[0] + _scaled(x[1], sign))
        if not any(a in r.parts for y in x for _, a, _ in y):
            return short
        long = _merged(_expanded(r, x[0]) + _scaled(_expanded(r, x[1]), sign))
        return long if len(long) < len(short) else short
    if name == "div":
        return _quotient(r, *x)
    if name == "sqrt":
        c, a, powers = _term(r, x[0])
        if c == 1 and r.graph.is_one(a) and len(powers) == 1 and _has_root(powers[0][1]):
            return ((1.0, a, ((powers[0][0], powers[0][1] // 2),)),)
    return ((1.0, r.graph.node(name, *(_node(r, y) for y in x)), ()),)


def _scaled(terms: Sum, factor: float) -> Sum:
    return tuple((factor * c, a, powers) for c, a, powers in terms)


def _merged(terms: Sum) -> Sum:
    """Like terms added up."""
    factors: dict[tuple[int, Powers], float] = {}
    for c, a, powers in terms:
        factors[a, powers] = factors.get((a, powers), 0.0) + c
    kept = tuple((c, *rest) for rest, c in factors.items() if c)
    return kept or ((0.0, *terms[0][1:]),)


def _term(r: _Rewriting, terms: Sum) -> Term:
    """A sum as factor × node × powers; what all terms have in common stays outside, also of some
    of them.
    """
    if len(terms) == 1:
        return terms[0]
    groups: dict[Powers, list[tuple[float, int]]] = {}
    for c, a, powers in terms:
        groups.setdefault(powers, []).append((c, a))
    added = {powers: _factored(r.graph, group) for powers, group in groups.items()}
    common = next(iter(added)) if len(added) == 1 else ()
    if len(added) > 1:
        added[common] = _factored(
            r.graph, [(c, _times(r, a, powers)) for powers, (c, a) in added.items()]
        )
    size, whole = added[common]
    if len(terms) <= FEW_TERMS:
        r.parts[whole] = tuple(
            (c / size, a, _joined(powers, _inverse(common))) for c, a, powers in terms
        )
    return size, whole, common


def _factored(graph: Graph, terms: list[tuple[float, int]]) -> tuple[float, int]:
    """The sum of factors times nodes; a factor common to all stays outside."""
    size = abs(terms[0][0])
    if len(terms) == 1:
        return terms[0]
    if any(abs(c) != size or graph.is_one(a) for c, a in terms):
        size = 1.0
    return size, _added(graph, [(c / size, a) for c, a in terms])


def _added(graph: Graph, terms: list[tuple[float, int]]) -> int:
    """The sum as a node: terms without a factor first, so that each further one is a fused
    multiply-add.
    """
    if len(terms) > LONGEST_CHAIN:
        half = len(terms) // 2
        return graph.node("add", _added(graph, terms[:half]), _added(graph, terms[half:]))
    first, *others = sorted(terms, key=lambda term: (term[0] != 1.0, term[0] != -1.0, term[0] < 0))
    total = _single(graph, *first)
    for c, a in others:
        total = graph.node("sub" if c < 0 else "add", total, _single(graph, abs(c), a))
    return total


def _single(graph: Graph, c: float, a: int) -> int:
    if graph.is_one(a) or not c:
        return graph.node("const", c)
    if c == 1:
        return a
    return graph.node("neg", a) if c == -1 else graph.node("mul", graph.node("const", c), a)


def _node(r: _Rewriting, terms: Sum) -> int:
    c, a, powers = _term(r, terms)
    return _single(r.graph, c, _times(r, a, powers) if c else a)


def _product(r: _Rewriting, x: Sum, y: Sum) -> Sum:
    for one, other in ((x, y), (y, x)):
        if len(one) == 1 and not one[0][2] and r.graph.is_one(one[0][1]):
            return _scaled(other, one[0][0])
    (c, a, powers), (d, b, more) = _term(r, x), _term(r, y)
    return ((c * d, r.graph.times(a, b), _joined(powers, more)),)


def _quotient(r: _Rewriting, x: Sum, y: Sum) -> Sum:
    d, b, below = _term(r, y)
    if d and r.graph.is_one(b) and not below:
        return _scaled(x, 1 / d)
    c, a, powers = _term(r, x)
    if not d:
        return ((1.0, r.graph.node("div", _node(r, x), _node(r, y)), ()),)
    powers = _joined(powers, _inverse(below))
    # one division for all its users
    single = tuple((base, -e) for base, e in powers if e < 0 and not r.kinds[base])
    powers = tuple((base, e) for base, e in powers if e > 0 or r.kinds[base])
    bottom = _times(r, b, single)
    return ((c / d, a if r.graph.is_one(bottom) else r.graph.node("div", a, bottom), powers),)


def _joined(powers: Powers, more: Powers) -> Powers:
    """The powers of a product."""
    if not (powers and more):
        return powers or more
    total = dict(powers)
    for base, e in more:
        total[base] = total.get(base, 0) + e
    return tuple(sorted((base, e) for base, e in total.items() if e))


def _inverse(powers: Powers) -> Powers:
    return tuple((base, -e) for base, e in powers)


def _times(r: _Rewriting, a: int, powers: Powers) -> int:
    """a × powers as a node; the powers come first, so that several nodes can share them."""
    same = varying = r.graph.one
    if not powers:
        return a
    for base, e in powers:
        power = _power(r.graph, base, e, r.kinds[base])
        if base in r.constant:
            same = r.graph.times(same, power)
        else:
            varying = r.graph.times(varying, power)
    return r.graph.times(a, r.graph.times(same, varying))


def _power(graph: Graph, base: int, exponent: int, kind: str) -> int:
    """base^(exponent / 4), by products, roots, and the reciprocal that the kind says."""
    if exponent < 0 and kind == "inverse":
        return _power(graph, graph.node("div", graph.one, base), -exponent, "")
    quarters = abs(exponent)
    # two roots side by side
    parts = [graph.node("sqrt", graph.node("sqrt", base))] if quarters & 1 else []
    inverse_root = (
        graph.node("rsqrt", base) if kind == "root" and (quarters & 2 or exponent < 0) else None
    )
    if exponent < 0:
        assert inverse_root is not None
        # x^-¼ = x^¼ x^-½
        parts.append(whole_power(graph, inverse_root, (quarters + (quarters & 1)) // 2))
    else:
        if quarters & 2:
            parts.append(
                graph.node("sqrt", base)
                if inverse_root is None
                else graph.node("mul", base, inverse_root)
            )
        parts.append(whole_power(graph, base, quarters // 4))
    result = graph.one
    for part in parts:
        result = graph.times(result, part)
    return result
