"""The operations of an SX function arranged for speed.

Equal operations appear once; numerical factors and powers move to the outside of products, where
those of equal bases merge and cancel; whole, half and quarter powers become multiplications and
square roots, and divisions by powers of one expression share one reciprocal. Each rewriting is
exact or costs one rounding.
"""

from __future__ import annotations

from collections import Counter
from itertools import chain

import casadi as ca

from varint.codegen.dependence import needed
from varint.codegen.graph import LEAVES, Graph, raw_graph
from varint.codegen.powers import Powers, has_root, inverse, joined, power_of
from varint.codegen.rewriting import Rewriting, Sum, Term, rewriting

FEW_TERMS = 8  # of a sum that is looked into, since some may cancel where it is used
LONGEST_CHAIN = 6  # terms of a sum added one after the other; longer sums are split, for latency


def graph_of(f: ca.Function, constants: int = -1) -> Graph:
    """The operations of the SX function f, rearranged for speed; outputs are dense.

    The argument with the index `constants` is the same all the time.
    """
    raw = raw_graph(f)
    live = needed(raw)
    r = rewriting(raw, live, constants % f.n_in())
    taken = [node[1:] for i in live if (node := raw.nodes[i])[0] not in LEAVES]
    uses, uniform, bases = Counter(chain(*taken, *raw.outputs)), r.uniform, r.bases
    sums = r.sums
    for i in live:
        terms = _rewritten(r, i)
        if uniform[i] or i in bases:
            terms = _as_power(r, i, terms)
        elif uses[i] > 1 and (len(terms) > 1 or terms[0][2]):
            terms = _shared(r, terms)
        sums[i] = terms
    r.graph.outputs = [[_node(r, sums[i]) for i in output] for output in raw.outputs]
    return r.graph


def _as_power(r: Rewriting, i: int, terms: Sum) -> Sum:
    """What the users of node i see, a base or what is the same all the time: its power."""
    c, a, powers = _term(r, terms)
    if a == r.graph.unit:
        return ((c, a, powers),)
    if r.uniform[i]:
        r.constant.add(a)
    r.kinds.setdefault(a, "inverse" if r.uniform[i] else r.bases[i])
    return ((c, r.graph.one, joined(powers, ((a, 4),))),)


def _shared(r: Rewriting, terms: Sum) -> Sum:
    """What the users of a sum see that are many."""
    c, a, powers = _term(r, terms)
    if not powers:
        return ((c, a, powers),)
    lasting = tuple(
        power for power in powers if r.kinds[power[0]] == "root" or power[0] in r.constant
    )
    # each of the users would multiply by the other powers again
    if a != r.graph.unit and lasting != powers:
        a = _times(r, a, joined(powers, inverse(lasting)))
        powers = lasting
    return ((c, a, powers),)


def _expanded(r: Rewriting, terms: Sum) -> Sum:
    """The sum with the terms of the sums in it: some may cancel."""
    result = list[Term]()
    for term in terms:
        c, a, powers = term
        if a in r.parts:
            size, parts, common = r.parts[a]
            rest = joined(powers, inverse(common))
            result += [(c * (d / size), b, joined(rest, more)) for d, b, more in parts]
        else:
            result.append(term)
    return tuple(result)


def _rewritten(r: Rewriting, i: int) -> Sum:
    """Node i of the raw graph as a sum of terms."""
    node, sums = r.raw.nodes[i], r.sums
    name, first, second = node[0], node[1], node[-1]
    if name == "mul":
        return _product(r, sums[first], sums[second])
    if name == "add":
        return _added_up(r, sums[first] + sums[second])
    if name == "sub":
        return _added_up(r, sums[first] + _scaled(sums[second], -1.0))
    if name == "const":
        return ((first, r.graph.one, ()),)
    if name == "input":
        return ((1.0, r.graph.node(*node), ()),)
    x = [sums[j] for j in node[1:]]
    if name == "neg":
        return _scaled(x[0], -1.0)
    if name == "div":
        return _quotient(r, *x)
    if name == "sqrt":
        c, a, powers = _term(r, x[0])
        if c == 1 and a == r.graph.unit and len(powers) == 1 and has_root(powers[0][1]):
            return ((1.0, a, ((powers[0][0], powers[0][1] // 2),)),)
    if name in ("fabs", "sign"):
        return _factor_by_factor(r, name, x[0])
    return ((1.0, r.graph.node(name, *(_node(r, y) for y in x)), ()),)


def _factor_by_factor(r: Rewriting, name: str, x: Sum) -> Sum:
    """|x| or the sign of x, of a product factor by factor: even powers and roots have none, and
    that of what is the same all the time is found once.
    """
    c, a, powers = _term(r, x)
    positive, same, varying = list[tuple[int, int]](), list[tuple[int, int]](), list(powers)
    for power in powers:
        base, e = power
        if e % 8 != 4 and (e < 0 or name == "fabs"):  # no zero, whose sign is 0
            positive.append(power)
        elif base in r.constant:
            same.append(power)
        else:
            continue
        varying.remove(power)
    found: Powers = tuple(positive) if name == "fabs" else ()
    if same:
        once = r.graph.node(name, _times(r, r.graph.one, tuple(same)))
        r.constant.add(once)
        r.kinds.setdefault(once, "inverse")
        found = joined(found, ((once, 4),))
    whole = _times(r, a, tuple(varying))
    size = abs(c) if name == "fabs" else float((c > 0) - (c < 0))
    return ((size, whole if whole == r.graph.unit else r.graph.node(name, whole), found),)


def _added_up(r: Rewriting, terms: Sum) -> Sum:
    """Like terms added up, also those of the sums in it where some of them cancel."""
    short, parts = _merged(terms), r.parts
    for _, a, _ in terms:
        if a in parts:
            long = _merged(_expanded(r, terms))
            return long if len(long) <= len(short) else short
    return short


def _scaled(terms: Sum, factor: float) -> Sum:
    return tuple([(factor * c, a, powers) for c, a, powers in terms])


def _merged(terms: Sum) -> Sum:
    """Like terms added up."""
    if len(terms) == 2:
        (c, a, powers), (d, b, more) = terms
        if (a != b or powers != more) and c and d:
            return terms
    factors: dict[tuple[int, Powers], float] = {}
    for c, a, powers in terms:
        factors[a, powers] = factors.get((a, powers), 0.0) + c
    if len(factors) == len(terms) and all(factors.values()):
        return terms
    kept = tuple([(c, a, powers) for (a, powers), c in factors.items() if c])
    return kept or ((0.0, *terms[0][1:]),)


def _term(r: Rewriting, terms: Sum) -> Term:
    """A sum as factor × node × powers; what all terms have in common stays outside, also of some
    of them.
    """
    if len(terms) == 1:
        return terms[0]
    common = _common(r, [powers for _, _, powers in terms])
    size, whole = _factored(r, _by_powers(r, terms, common))
    if len(terms) <= FEW_TERMS:
        r.parts[whole] = size, terms, common
    return size, whole, common


def _common(r: Rewriting, each: list[Powers]) -> Powers:
    """The powers that are factors of all, but for what is the same all the time, where it is not
    all of them: other sums may share it with the factors beside it.
    """
    if not all(each):
        return ()
    first, *others = each
    if all(powers == first for powers in others):
        return first
    found, rest = list[tuple[int, int]](), [dict(powers) for powers in others]
    for base, e in first:
        exponents = [e, *(powers.get(base, 0) for powers in rest)]
        least, most = min(exponents), max(exponents)
        if base not in r.constant and (least > 0 or most < 0):
            found.append((base, least if least > 0 else most))
    return tuple(found)


def _by_powers(r: Rewriting, terms: Sum, common: Powers) -> list[tuple[float, int]]:
    """The terms over the powers that they have in common, those that share a factor added up
    before they are multiplied by it, so that it is not waited for.
    """
    below = inverse(common)
    groups: dict[Powers, list[Term]] = {}
    for c, a, powers in terms:
        groups.setdefault(joined(powers, below), []).append((c, a, ()))
    found = []
    open_groups = list(groups.items())
    while open_groups:
        shared = _most_shared(r, [powers for powers, _ in open_groups])
        if shared is None:
            break
        inside = [x for x in open_groups if any((b, e > 0) == shared for b, e in x[0])]
        open_groups = [x for x in open_groups if x not in inside]
        parts = tuple((c, a, powers) for powers, group in inside for c, a, _ in group)
        sign = -1.0 if all(c < 0 for c, _, _ in parts) else 1.0
        c, a, powers = _term(r, _scaled(parts, sign))
        found.append((sign * c, _times(r, a, powers)))
    for powers, group in open_groups:
        c, a = _factored(r, [(c, a) for c, a, _ in group])
        found.append((c, _times(r, a, powers)))
    return found


def _most_shared(r: Rewriting, each: list[Powers]) -> tuple[int, bool] | None:
    """The base that most of them multiply or divide by, and which of it; of several the last."""
    counts: dict[tuple[int, bool], int] = {}
    for powers in each:
        for base, e in powers:
            if base not in r.constant:
                which = base, e > 0
                counts[which] = counts.get(which, 0) + 1
    many, which = max([(n, x) for x, n in counts.items()], default=(0, (0, False)))
    return which if many > 1 else None


def _factored(r: Rewriting, terms: list[tuple[float, int]]) -> tuple[float, int]:
    """The sum of factors times nodes; a factor common to all stays outside."""
    if len(terms) == 1:
        return terms[0]
    size = abs(terms[0][0])
    if size != 1.0 and not any(abs(c) != size or a == r.graph.unit for c, a in terms):
        terms = [(c / size, a) for c, a in terms]
    else:
        size = 1.0
    same = [term for term in terms if term[1] == r.graph.unit or term[1] in r.constant]
    others = [term for term in terms if term not in same]
    if len(same) > 1 and others:  # added up once
        same = [(1.0, _added(r, same))]
        r.constant.add(same[0][1])
    return size, _added(r, same + others)  # what is not waited for first


def _added(r: Rewriting, terms: list[tuple[float, int]]) -> int:
    """The sum as a node: terms without a factor first, so that each further one is a fused
    multiply-add.
    """
    if len(terms) > LONGEST_CHAIN:
        half = len(terms) // 2
        return r.graph.node("add", _added(r, terms[:half]), _added(r, terms[half:]))
    first, *others = sorted(terms, key=_place)
    total = _single(r, *first)
    for c, a in others:
        total = r.graph.node("sub" if c < 0 else "add", total, _single(r, abs(c), a))
    return total


def _place(term: tuple[float, int]) -> int:
    """Of a term among others: 1, −1, other positive factors, negative ones."""
    c = term[0]
    return 0 if c == 1.0 else 1 if c == -1.0 else 3 if c < 0 else 2


def _single(r: Rewriting, c: float, a: int) -> int:
    graph = r.graph
    if c == 1.0 and a != graph.unit:
        return a
    if a == graph.unit or not c:
        return graph.node("const", c)
    if c == -1:
        return graph.node("neg", a)
    return graph.node("mul", graph.node("const", c), a)


def _node(r: Rewriting, terms: Sum) -> int:
    c, a, powers = _term(r, terms)
    return _single(r, c, _times(r, a, powers) if c else a)


def _product(r: Rewriting, x: Sum, y: Sum) -> Sum:
    graph = r.graph
    if len(x) == 1 and x[0][1] == graph.unit and not x[0][2]:
        return _scaled(y, x[0][0])
    if len(y) == 1 and y[0][1] == graph.unit and not y[0][2]:
        return _scaled(x, y[0][0])
    c, a, powers = x[0] if len(x) == 1 else _term(r, x)
    d, b, more = y[0] if len(y) == 1 else _term(r, y)
    return ((c * d, graph.times(a, b), joined(powers, more)),)


def _quotient(r: Rewriting, x: Sum, y: Sum) -> Sum:
    d, b, below = _term(r, y)
    if d and b == r.graph.unit and not below:
        return _scaled(x, 1 / d)
    c, a, powers = _term(r, x)
    if not d:
        return ((1.0, r.graph.node("div", _node(r, x), _node(r, y)), ()),)
    powers = joined(powers, inverse(below))
    # one division for all its users
    single = tuple((base, -e) for base, e in powers if e < 0 and not r.kinds[base])
    powers = tuple((base, e) for base, e in powers if e > 0 or r.kinds[base])
    bottom = _times(r, b, single)
    return ((c / d, a if bottom == r.graph.unit else r.graph.node("div", a, bottom), powers),)


def _times(r: Rewriting, a: int, powers: Powers) -> int:
    """a × powers as a node; the powers come first, so that several nodes can share them."""
    same = varying = r.graph.one
    if not powers:
        return a
    for base, e in powers:
        power = power_of(r.graph, base, e, r.kinds[base])
        if base in r.constant:
            same = r.graph.times(same, power)
        else:
            varying = r.graph.times(varying, power)
    whole = r.graph.times(same, varying)
    if varying == r.graph.unit:
        r.constant.add(whole)
    return r.graph.times(a, whole)
