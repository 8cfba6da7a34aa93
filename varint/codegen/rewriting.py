"""A graph on its way to one that is quicker, and which of its nodes are bases of powers."""

from __future__ import annotations

from dataclasses import dataclass, field

from varint.codegen.dependence import uniform_nodes
from varint.codegen.graph import Graph
from varint.codegen.powers import Powers, has_root

Term = tuple[float, int, Powers]  # factor × node × powers
Sum = tuple[Term, ...]


@dataclass
class Rewriting:
    """A raw graph and what becomes of it, node by node.

    `bases` are the raw nodes whose powers are gathered, those below a root or a division, and how
    their powers are written: by 1/√base ("root"), by 1/base ("inverse"), else by a division each;
    `kinds` the same for new nodes. Of the new nodes, `constant` are the same all the time, and
    `parts` are (size, terms, powers) of a short sum: it is all its terms over size and powers.
    """

    raw: Graph
    bases: dict[int, str]
    uniform: list[bool]
    graph: Graph = field(default_factory=Graph)
    sums: dict[int, Sum] = field(default_factory=dict)
    kinds: dict[int, str] = field(default_factory=dict)
    constant: set[int] = field(default_factory=set)
    parts: dict[int, tuple[float, Sum, Powers]] = field(default_factory=dict)


def rewriting(raw: Graph, live: list[int], constants: int) -> Rewriting:
    uniform = uniform_nodes(raw, constants)
    asked = {raw.nodes[i][-1] for i in live if raw.nodes[i][0] in ("div", "sqrt")}
    for i in reversed(live) if asked else ():
        if i in asked and raw.nodes[i][0] in _MONOMIAL:
            asked.update(raw.nodes[i][1:])
    monomials = dict[int, tuple[float, int | None, int]]()
    for i in sorted(asked):
        monomials[i] = _monomial(monomials, uniform, i, raw.nodes[i])
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
    return Rewriting(raw, bases, uniform)


_MONOMIAL = frozenset(("neg", "sqrt", "mul"))  # of monomials


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
        return (1.0, base, e // 2) if base is not None and c == 1 and has_root(e) else atom
    if name == "mul":
        (c, base, e), (d, other, g) = known[rest[0]], known[rest[1]]
        if base is None or other is None or base == other:
            return (c * d, other if base is None else base, e + g)
        if uniform[rest[0]] != uniform[rest[1]]:
            return (d, other, g) if uniform[rest[0]] else (c, base, e)
    return atom
