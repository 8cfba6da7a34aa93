"""C source of blocks that repeat: every form once, and tables that say where its values lie.

What one block leaves for another lies in an array `m`, whose places are used again. A form reads
its places from a table that goes on from block to block; what is the same for all blocks of a form
is written in its code.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from varint.codegen.repeats import Block, Repeats
from varint.codegen.rolled import c_expression

ENTRIES = 16  # of tables: they take the compiler as long as a statement


class Written(NamedTuple):
    """C functions (name → statements), the tables they need, the statements that call them, the
    length of all, and how many statements a call executes.
    """

    functions: dict[str, list[str]]
    tables: str
    calls: list[str]
    length: int
    executed: int


@dataclass
class _Form:
    """Blocks that differ in places and numbers alone: C statements, and what differs by block."""

    text: list[str] = field(default_factory=list)
    places: dict[tuple[int, ...], int] = field(default_factory=dict)
    numbers: dict[tuple[str, ...], int] = field(default_factory=dict)

    def place(self, column: Sequence[int]) -> str:
        """C text of the place of every block."""
        if len(set(column)) == 1:
            return str(column[0])
        return f"at[{self.places.setdefault(tuple(column), len(self.places))}]"

    def number(self, column: Sequence[str]) -> str:
        if len(set(column)) == 1:
            return column[0]
        return f"c[{self.numbers.setdefault(tuple(column), len(self.numbers))}]"


def c_repeats(
    name: str,
    found: Repeats,
    arguments: str,
    stride: str,
    constant: Callable[[int], str],
    kept: Callable[[int], int],
) -> Written:
    """The blocks as C.

    Parameters
    ----------
    name : str
        Of the function; its forms are numbered.
    found : Repeats
    arguments : str
        What every form is called with, besides its tables and `m`.
    stride : str
        C expression: component i of an argument is found at ``x[i * stride]``.
    constant, kept : callable
        Node of a number → its C text; of what is the same all the time → its place in w.
    """
    places, room = _places(found)
    members: dict[int, list[int]] = defaultdict(list)
    for k, shape in enumerate(found.shapes):
        members[shape].append(k)
    forms = [
        _form(found, [found.order[k] for k in ks], places, stride, constant, kept)
        for ks in members.values()
    ]
    number = {shape: n for n, shape in enumerate(members)}
    order = [number[shape] for shape in found.shapes]
    at, numbers, met = list[int](), list[str](), [0] * len(forms)
    for n in order:
        at += [column[met[n]] for column in forms[n].places]
        numbers += [column[met[n]] for column in forms[n].numbers]
        met[n] += 1
    cases = [
        f"case {n}: {name}_{n}({arguments}, at, c, m); at += {len(form.places)}; "
        f"c += {len(form.numbers)}; break;"
        for n, form in enumerate(forms)
    ]
    calls = [
        f"V m[{room}];",
        f"const int32_t *at = {name}_at; const double *c = {name}_c;",
        f"for (int k = 0; k < {len(order)}; k++) switch ({name}_order[k]) {{",
        *cases,
        "}",
        *_at_once(found, stride, constant),
    ]
    tables = _table("int32_t", f"{name}_at", map(str, at)) + _table("double", f"{name}_c", numbers)
    return Written(
        {f"{name}_{n}": form.text for n, form in enumerate(forms)},
        tables + _table("int32_t", f"{name}_order", map(str, order)),
        calls,
        sum(len(form.text) for form in forms)
        + len(calls)
        + (len(at) + len(numbers) + len(order)) // ENTRIES,
        sum(len(forms[n].text) for n in order),
    )


def _at_once(found: Repeats, stride: str, constant: Callable[[int], str]) -> list[str]:
    """Stores of outputs that no operation makes: numbers, what is the same all the time, inputs."""
    nodes, result = found.graph.nodes, []
    for i, ends in found.stored.items():
        if found.uniform[i]:
            value = f"splat({constant(i)})"
        elif nodes[i][0] == "input":
            value = f"i{nodes[i][1]}[{nodes[i][2]} * ({stride})]"
        else:
            continue
        result += [f"o{k}[{row} * ({stride})] = {value};" for k, row in ends]
    return result


def _table(kind: str, name: str, values: Iterable[str]) -> str:
    return f"static const {kind} {name}[] = {{{', '.join(values) or '0'}}};\n"


def _places(found: Repeats) -> tuple[dict[int, int], int]:
    """Where in `m` the values lie that other blocks take, and the length of m; place 0 is never
    read.
    """
    last: dict[int, int] = {}
    made: dict[int, int] = {}
    for k, block in enumerate(found.order):
        for unit in block:
            made |= dict.fromkeys(unit, k)
            last |= {j: k for j in found.taken[unit] if made.get(j, k) < k}
    ends: dict[int, list[int]] = defaultdict(list)
    for i, k in last.items():
        ends[k].append(i)
    places: dict[int, int] = {}
    free, room = list[int](), 1
    for k, block in enumerate(found.order):
        for i in (i for unit in block for i in unit if i in last):
            if not free:
                free.append(room)
                room += 1
            places[i] = free.pop()
        free += [places[i] for i in ends[k]]  # not within the block: it reads them anywhere
    return places, room


def _form(
    found: Repeats,
    blocks: Sequence[Block],
    places: dict[int, int],
    stride: str,
    constant: Callable[[int], str],
    kept: Callable[[int], int],
) -> _Form:
    """The statements of blocks of one shape."""
    form, nodes, known = _Form(), found.graph.nodes, dict[int, str]()

    def taken(column: Sequence[int]) -> str:
        first = column[0]
        if nodes[first][0] == "const":
            return form.number([constant(j) for j in column])
        if found.uniform[first]:
            return f"w[{form.place([kept(j) for j in column])}]"
        if first not in known:
            known[first] = f"x{len(known)}"
            if nodes[first][0] == "input":
                row = form.place([nodes[j][2] for j in column])
                source = f"i{nodes[first][1]}[{row} * ({stride})]"
            else:
                source = f"m[{form.place([places[j] for j in column])}]"
            form.text.append(f"const V {known[first]} = {source};")
        return known[first]

    for units in zip(*blocks, strict=True):
        operands = [taken(column) for column in zip(*(found.taken[x] for x in units), strict=True)]
        first = units[0]
        for i in first:
            known[i] = f"x{len(known)}"
        if len(first) == 2:
            sine, cosine = (known[i] for i in first)
            form.text.append(f"V {sine}, {cosine}; v_sincos({operands[0]}, &{sine}, &{cosine});")
        else:
            same = [found.uniform[j] for j in found.taken[first]]
            name = nodes[first[0]][0]
            form.text.append(f"const V {known[first[0]]} = {c_expression(name, operands, same)};")
        for column in zip(*units, strict=True):
            value = known[column[0]]
            if any(i in places for i in column):
                form.text.append(f"m[{form.place([places.get(i, 0) for i in column])}] = {value};")
            for ends in zip(*(found.stored.get(i, ()) for i in column), strict=True):
                row = form.place([row for _, row in ends])
                form.text.append(f"o{ends[0][0]}[{row} * ({stride})] = {value};")
    return form
