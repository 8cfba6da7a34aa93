"""Long functions as loops: operations of the same form, as for every pair of many bodies, become
one loop over arrays.

Two values have the same form when the same operation makes them from values of the same forms, and
the same operations use them. Forms that go together place by place share a loop, whose values stay
in registers; long sums become rows of places to add up. The C source then grows with the number of
forms, not with the number of bodies.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import accumulate

from varint.codegen.graph import COMMUTATIVE, Graph, operands

LONG_SUM = 6  # terms from which on a sum is a row of places
ON_THE_STACK = 16_384  # vectors; more are kept by the thread
INFIX = {"add": "+", "sub": "-", "mul": "*", "div": "/"}
NUMBER, SAME, ARGUMENT = -1, -2, -3  # kinds of operands that no form makes; arguments count down
Text = Callable[[int], str]


@dataclass
class Forms:
    """The varying values of a graph by form, in an order of evaluation.

    Attributes
    ----------
    members : list of list of int
        The nodes of every form.
    kinds : dict
        Node → index of its form; below zero for numbers, what is the same all the time, and
        arguments.
    place : dict
        Node → its place among those of its form.
    terms : dict
        Node of a long sum → its terms, as (sign, node).
    """

    graph: Graph
    members: list[list[int]] = field(default_factory=list)
    kinds: dict[int, int] = field(default_factory=dict)
    place: dict[int, int] = field(default_factory=dict)
    terms: dict[int, list[tuple[int, int]]] = field(default_factory=dict)

    def operands(self, i: int) -> tuple[int, ...]:
        """Operands of a node, in an order that depends on their forms where the operation allows
        it.
        """
        name, *rest = self.graph.nodes[i]
        return (
            tuple(sorted(rest, key=self.kinds.__getitem__)) if name in COMMUTATIVE else tuple(rest)
        )


def group_by_form(graph: Graph, live: Sequence[int], uniform: list[bool]) -> Forms:
    """The forms of what varies."""
    forms = Forms(graph)
    varying = []
    for i in live:
        name, *rest = graph.nodes[i]
        if uniform[i]:
            forms.kinds[i] = NUMBER if name == "const" else SAME
        elif name == "input":
            forms.kinds[i] = ARGUMENT - rest[0]
        else:
            varying.append(i)
    inner = _find_sums(forms, varying, uniform)
    varying = [i for i in varying if i not in inner]
    _classify(forms, varying, lambda i: 0)
    users: dict[int, set] = {}
    for i in reversed(varying):
        used = frozenset(users.pop(i, ()))
        users[i] = {used}  # what the node's own use is, once all its users are known
        role = (forms.kinds[i], used)
        for position, j in enumerate(forms.operands(i)) if i not in forms.terms else forms.terms[i]:
            users.setdefault(j, set()).add((hash(role), position))
    uses = {i: hash(frozenset(users[i])) for i in varying}
    _classify(forms, varying, uses.__getitem__)
    return forms


def _find_sums(forms: Forms, varying: list[int], uniform: list[bool]) -> set[int]:
    """Sums of sums with many terms; the sums within them that nothing else uses."""
    graph = forms.graph
    uses = Counter(j for i in varying for j in operands(graph.nodes[i]))
    uses.update(i for output in graph.outputs for i in output)
    inner: set[int] = set()
    for i in reversed(varying):
        if i in inner or graph.nodes[i][0] not in ("add", "sub"):
            continue
        terms: list[tuple[int, int]] = []
        within, waiting = set(), [(1, i)]
        while waiting:
            sign, j = waiting.pop()
            name, *rest = graph.nodes[j]
            if j == i or (name in ("add", "sub", "neg") and uses[j] == 1 and not uniform[j]):
                within.add(j)
                waiting += [
                    (-sign if name == "neg" or (name == "sub" and n) else sign, x)
                    for n, x in enumerate(rest)
                ]
            else:
                terms.append((sign, j))
        if len(terms) >= LONG_SUM:
            forms.terms[i] = terms
            inner |= within - {i}
    return inner


def _classify(forms: Forms, varying: list[int], use: Callable[[int], int]) -> None:
    """Number the forms: by operation, forms of the operands, and use."""
    known: dict[tuple, int] = {}
    forms.members = []
    for i in varying:
        if i in forms.terms:
            form = ("sum", use(i), *sorted({forms.kinds[j] for _, j in forms.terms[i]}))
        else:
            form = (forms.graph.nodes[i][0], use(i), *(forms.kinds[j] for j in forms.operands(i)))
        if form not in known:
            known[form] = len(known)
            forms.members.append([])
        k = known[form]
        forms.kinds[i], forms.place[i] = k, len(forms.members[k])
        forms.members[k].append(i)


def c_loops(
    forms: Forms, stride: str, constant: Text, kept: Callable[[int], int]
) -> tuple[list[str], dict[int, str]]:
    """C statements that compute the outputs, and the text of every output's node.

    Parameters
    ----------
    stride : str
        C expression: component i of an argument is found at ``x[i * stride]``.
    constant, kept : callable
        Node of a number, or of what is the same all the time → its C text; the latter's place in w.
    """
    groups, group_of = _group_forms(forms)
    writer = _Writer(forms, group_of, stride, constant, kept)
    body = [line for group in groups for line in writer.loop(group)]
    sizes = {k: len(forms.members[k]) for k in sorted(writer.stored)}
    declared = [f"V a{k}[{size}];" for k, size in sizes.items()]
    # one array for all, whose place is asked for once a call
    if sum(sizes.values()) > ON_THE_STACK:
        starts = accumulate(sizes.values(), initial=0)
        declared = [f"static _Thread_local V storage[{sum(sizes.values())}];"]
        declared += [
            f"V *const restrict a{k} = storage + {start};"
            for k, start in zip(sizes, starts, strict=False)
        ]
    outputs = {
        i: f"a{forms.kinds[i]}[{forms.place[i]}]"
        for output in forms.graph.outputs
        for i in output
        if i in forms.place
    }
    return declared + writer.tables + body, outputs


def _group_forms(forms: Forms) -> tuple[list[list[int]], list[int]]:
    """Forms that share a loop: as many places each, and what they take from one another is at
    the same place.
    """
    groups: list[list[int]] = []
    group_of: list[int] = []
    latest: dict[int, int] = {}  # number of places → the last group with so many
    for k, nodes in enumerate(forms.members):
        made = (
            [] if nodes[0] in forms.terms else list(zip(*map(forms.operands, nodes), strict=True))
        )
        g = latest.get(len(nodes), -1) if made else -1
        for column in made:
            kind = forms.kinds[column[0]]
            if kind >= 0 and g >= 0:
                beside = group_of[kind] == g and all(
                    forms.place[j] == n for n, j in enumerate(column)
                )
                g = g if beside or group_of[kind] < g else -1
        if g < 0:
            g = len(groups)
            groups.append([])
            if made:
                latest[len(nodes)] = g
        groups[g].append(k)
        group_of.append(g)
    return groups, group_of


class _Writer:
    """Writes loops; collects the tables they need and the forms that others than their own loop
    ask for.
    """

    def __init__(
        self,
        forms: Forms,
        group_of: list[int],
        stride: str,
        constant: Text,
        kept: Callable[[int], int],
    ) -> None:
        self.forms, self.group_of, self.stride, self.constant, self.kept = (
            forms,
            group_of,
            stride,
            constant,
            kept,
        )
        self.tables: list[str] = []
        self.known: dict[tuple[str, ...], str] = {}
        outputs = {
            forms.kinds[i] for output in forms.graph.outputs for i in output if i in forms.place
        }
        self.stored = outputs | {forms.kinds[i] for i in forms.terms}
        for k, nodes in enumerate(forms.members):
            taken = (
                forms.terms[nodes[0]]
                if nodes[0] in forms.terms
                else [(0, j) for j in forms.operands(nodes[0])]
            )
            for kind in {forms.kinds[j] for _, j in taken}:
                if kind >= 0 and group_of[kind] != group_of[k]:
                    self.stored.add(kind)

    def loop(self, group: list[int]) -> list[str]:
        nodes = self.forms.members[group[0]]
        if nodes[0] in self.forms.terms:
            return self._sums(nodes, group[0])
        lines = [line for k in group for line in self._statements(k)]
        return [f"for (int k = 0; k < {len(nodes)}; k++) {{ {' '.join(lines)} }}"]

    def _statements(self, k: int) -> list[str]:
        nodes = self.forms.members[k]
        name = self.forms.graph.nodes[nodes[0]][0]
        columns = list(zip(*map(self.forms.operands, nodes), strict=True))
        texts = [self._column(column, self.group_of[k]) for column in columns]
        same = [self.forms.kinds[column[0]] in (NUMBER, SAME) for column in columns]
        lines = [f"const V x{k} = {c_expression(name, texts, same)};"]
        return lines + ([f"a{k}[k] = x{k};"] if k in self.stored else [])

    def _sums(self, nodes: list[int], number: int) -> list[str]:
        """The sums of one form: for every kind and sign of terms a loop over their places, row
        by row.
        """
        forms, rows = self.forms, f"for (int r = 0; r < {len(nodes)}; r++)"
        lines = [f"{rows} a{number}[r] = splat(0.0);"]
        for kind, sign in sorted(
            {(forms.kinds[j], sign) for i in nodes for sign, j in forms.terms[i]}
        ):
            terms = [
                [j for s, j in forms.terms[i] if (forms.kinds[j], s) == (kind, sign)] for i in nodes
            ]
            ends = self._table(
                "int32_t", [str(sum(map(len, terms[:r]))) for r in range(len(nodes) + 1)]
            )
            term = self._column([j for row in terms for j in row], -1)
            lines.append(
                f"{rows} {{ V s = splat(0.0); for (int k = {ends}[r]; k < {ends}[r + 1]; k++) s += "
                f"{term}; a{number}[r] {'+' if sign > 0 else '-'}= s; }}"
            )
        return lines

    def _column(self, nodes: Sequence[int], group: int) -> str:
        """The k-th of the nodes, which are of one kind."""
        forms, kind, first = self.forms, self.forms.kinds[nodes[0]], nodes[0]
        if kind >= 0:
            if self.group_of[kind] == group:
                return f"x{kind}"
            return f"a{kind}[{self._places([forms.place[i] for i in nodes])}]"
        if kind <= ARGUMENT:
            places = self._places([forms.graph.nodes[i][2] for i in nodes])
            return f"i{ARGUMENT - kind}[({places}) * ({self.stride})]"
        if all(i == first for i in nodes):
            return self.constant(first)
        if kind == SAME:
            return f"w[{self._places([self.kept(i) for i in nodes])}]"
        return f"{self._table('double', [self.constant(i) for i in nodes])}[k]"

    def _places(self, values: list[int]) -> str:
        start = values[0]
        if values == list(range(start, start + len(values))):
            return f"k + {start}" if start else "k"
        return f"{self._table('int32_t', [str(x) for x in values])}[k]"

    def _table(self, kind: str, values: list[str]) -> str:
        key = (kind, *values)
        if key not in self.known:
            self.known[key] = f"T{len(self.known)}"
            self.tables.append(
                f"static const {kind} {self.known[key]}[] = {{{', '.join(values)}}};"
            )
        return self.known[key]


def c_expression(name: str, texts: Sequence[str], same: Sequence[bool]) -> str:
    """C expression of an operation on vectors; operands that are the same in all lanes are plain
    numbers.
    """
    if name == "neg":
        return f"-{texts[0]}"
    if name in INFIX:
        return f"{texts[0]} {INFIX[name]} {texts[1]}"
    arguments = (f"splat({x})" if y else x for x, y in zip(texts, same, strict=True))
    return f"v_{name}({', '.join(arguments)})"
