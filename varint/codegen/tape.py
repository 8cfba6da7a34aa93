"""An SX function as data for the machine of c/tape.h: nothing is compiled for it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from heapq import heappop, heappush
from itertools import chain
from typing import NamedTuple

import numpy as np

from varint.codegen.arguments import c_source
from varint.codegen.dependence import counted, needed, sine_and_cosine, uniform_nodes
from varint.codegen.graph import Graph, NotCompilable, operands

MOST = 65_535  # registers, operands are numbers of 16 bits
# operations between one and another that takes its value, where there are others to do: so long it
# takes until a value that was written can be read
APART = 8
SLOW = {"div": 2, "sqrt": 3, "rsqrt": 3, "sin": 6, "cos": 6, "exp": 5, "pow": 15}
# what is ±a·b ± c: where a, b and c come from, and the bits of the minus signs
SUMS = {
    "add": ("a1b", 0),
    "sub": ("b1a", 1),
    "mul": ("ab0", 0),
    "neg": ("a10", 1),
    "fma": ("abc", 0),
    "fms": ("abc", 2),
    "fnma": ("abc", 1),
}
EXACT, ITERATED = "rsqrt_exact", "rsqrt_iterated"  # 1/√x where roots are few, and many
RESERVED = {"1": 0, "0": 1}  # the registers of 1 and −0
# the same, by places among the reserved registers and then those of the operands
_SUMS = {name: (["10abc".index(x) for x in what], signs) for name, (what, signs) in SUMS.items()}


class Sizes(NamedTuple):
    """Of a graph: its nodes, those that do not depend on the parameters alone, and the square roots
    among them.
    """

    nodes: int
    operations: int
    roots: int


@dataclass(frozen=True, eq=False)
class Tape:
    """A function's operations; see c/tape.h.

    Attributes
    ----------
    sizes : Sizes
        Of the graph that they were.
    uniforms, numbers, registers : int
        Registers of what is the same all the time, numbers of `once`, registers in all.
    once, often : array (…, 6) of uint16
        Operations on the parameters alone, and those of a call.
    constants : array
    inputs, outputs : array (…, 3) of uint16
        (argument, component, register).
    """

    sizes: Sizes
    uniforms: int
    numbers: int
    registers: int
    once: np.ndarray
    often: np.ndarray
    constants: np.ndarray
    inputs: np.ndarray
    outputs: np.ndarray


_NO_OPERATION, _NO_PLACES = np.zeros((1, 6), np.uint16), np.zeros((0, 3), np.uint16)
NOTHING_TO_DO = Tape(
    Sizes(0, 0, 0), 0, 0, 0, _NO_OPERATION, _NO_OPERATION, np.zeros(1), _NO_PLACES, _NO_PLACES
)


@cache
def operation_codes() -> dict[str, int]:
    """The machine's operations by name, as c/tape.h lists them."""
    text, names = c_source("tape.h").replace("\\\n", ""), list[str]()
    for name in ("OPERATIONS", "ONLY_ONCE", "ONLY_OFTEN"):
        calls = text.partition(f"#define {name}(")[2].partition("\n")[0].partition(")")[2]
        names += [call.partition("(")[2] for call in calls.split(")") if "(" in call]
    return {name: k for k, name in enumerate(["end", *names])}


def tape_of(graph: Graph, last: int) -> Tape:
    """The tape of a graph on inputs 0 to `last`, the last of which is the same all the time, for
    few square roots.

    Raises
    ------
    NotCompilable
        If an operation has no form there, or there are too many.
    """
    codes, uniform = operation_codes(), uniform_nodes(graph, last)
    live = needed(graph)
    unknown = {graph.nodes[i][0] for i in live} - {*codes, *SUMS, "input", "const"}
    if unknown:
        raise NotCompilable(f"{sorted(unknown)} have no form on a tape; use backend='compiled'")
    varying = [i for i in live if not uniform[i]]
    wanted = [i for output in graph.outputs for i in output]
    kept = {j: None for i in varying for j in operands(graph.nodes[i]) if uniform[j]}
    kept |= {i: None for i in wanted if uniform[i]}
    places = {i: k for k, i in enumerate(kept, len(RESERVED))}
    uniforms = len(RESERVED) + len(places)
    once, constants, numbers = _once(graph, [i for i in live if uniform[i]], places)
    often, inputs, registers = _often(graph, varying, uniform, places, set(wanted))
    outputs: list[tuple[int, ...]] = [
        (k, r, places[i]) for k, output in enumerate(graph.outputs) for r, i in enumerate(output)
    ]
    tables = _table(once, 6), _table(often, 6), np.array([*constants, 0.0])
    ends = _table(inputs, 3), _table(outputs, 3)
    sizes = Sizes(len(graph.nodes), *counted(graph, varying))
    return Tape(sizes, uniforms, numbers, registers, *tables, *ends)


def with_many_roots(tape: Tape) -> Tape:
    """The same where reciprocal square roots count by their number, not by their latency."""
    codes, often = operation_codes(), tape.often.copy()
    often[often[:, 0] == codes[EXACT], 0] = codes[ITERATED]
    return replace(tape, often=often)


def _table(rows: list[tuple[int, ...]], width: int) -> np.ndarray:
    table = np.fromiter(chain.from_iterable(rows), np.int64, width * len(rows))
    if table.max(initial=0) > MOST:
        raise NotCompilable("too many values for a tape; use backend='compiled'")
    return table.astype(np.uint16).reshape(-1, width)


def _once(
    graph: Graph, uniform: list[int], kept: dict[int, int]
) -> tuple[list[tuple[int, ...]], list[float], int]:
    """Operations on what is the same all the time, their constants, and how many numbers there
    are; what is kept stands first.
    """
    codes, places, constants = operation_codes(), dict(kept), list[float]()
    rows = []
    for i in uniform:
        name, *rest = graph.nodes[i]
        place = places.setdefault(i, len(RESERVED) + len(places))
        if name == "const":
            rows.append(_row(codes["constant"], place, len(constants)))
            constants.append(rest[0])
        elif name == "input":
            rows.append(_row(codes["parameter"], place, rest[1]))
        else:
            rows.append(_row(codes[name], place, *(places[j] for j in rest)))
    return [*rows, _row(codes["end"])], constants, len(RESERVED) + len(places)


def _often(
    graph: Graph,
    varying: list[int],
    uniform: list[bool],
    places: dict[int, int],
    ends: set[int],
) -> tuple[list[tuple[int, ...]], list[tuple[int, ...]], int]:
    """Operations of a call, the inputs they begin with, and how many registers there are.

    `places` are the registers of what is the same all the time, and become those of the outputs,
    too. A register is used again once its value has been taken for the last time.
    """
    codes, count = operation_codes(), len(RESERVED) + len(places)
    nodes, free = graph.nodes, list[int]()
    inputs, rows = list[tuple[int, ...]](), list[tuple[int, ...]]()
    work, taken = _in_turns(graph, varying, uniform)
    last = {j: k for k, used in enumerate(taken) for j in used}
    for unit in work:
        name, *rest = nodes[unit[0]]
        if name == "input":
            places[unit[0]] = count
            inputs.append((rest[0], rest[1], count))
            count += 1
    total = codes["sum"]
    for k, unit in enumerate(work):
        node = nodes[unit[0]]
        name = node[0]
        if name == "input":
            continue
        at = [places[j] for j in node[1:]]
        for j in taken[k]:
            if last[j] == k and j not in ends:
                free.append(places[j])
        for j in unit:
            if free:
                places[j] = free.pop()
            else:
                places[j], count = count, count + 1
        if name in SUMS:
            (a, b, c), signs = _SUMS[name]
            among = (0, 1, *at)  # RESERVED
            rows.append((total, places[unit[0]], among[a], among[b], among[c], signs))
        elif len(unit) == 2:
            rows.append(_row(codes["sincos"], places[unit[0]], *at, places[unit[1]]))
        else:
            rows.append(_row(codes[EXACT if name == "rsqrt" else name], places[unit[0]], *at))
        for j in unit:
            if j not in last and j not in ends:
                free.append(places[j])
    return [*rows, _row(codes["end"])], inputs, count


def _in_turns(
    graph: Graph, varying: list[int], uniform: list[bool]
) -> tuple[list[tuple[int, ...]], list[set[int]]]:
    """The operations, sine and cosine of an angle as one, in an order for speed: the same kind
    again where there is one whose operands are known; among those, first what does not wait for
    the ones just before, and then what the longest chain of others hangs on. For each of them what
    varies that it takes.
    """
    pairs, nodes = sine_and_cosine(graph, varying, uniform), graph.nodes
    units = [pairs.get(i, (i,)) for i in varying if pairs.get(i) != (0, 0)]
    unit_of = {i: k for k, unit in enumerate(units) for i in unit}
    # both of a pair take the same
    firsts = [nodes[unit[0]] for unit in units]
    taken = [{j for j in operands(node) if not uniform[j]} for node in firsts]
    names = [node[0] for node in firsts]
    kinds = ["sum" if name in SUMS else name for name in names]
    takes_time = [APART * SLOW.get(name, 1) for name in names]
    users: list[list[int]] = [[] for _ in units]
    hanging = takes_time.copy()
    for k in range(len(units) - 1, -1, -1):
        for i in taken[k]:
            j = unit_of[i]
            users[j].append(k)
            hanging[j] = max(hanging[j], hanging[k] + takes_time[j])
    missing, known = [*map(len, taken)], [0] * len(units)
    ready: dict[str, list[tuple[int, int, int]]] = {}
    for k, count in enumerate(missing):
        if not count:
            heappush(ready.setdefault(kinds[k], []), (0, -hanging[k], k))
    order: list[int] = []
    kind = ""
    for turn in range(1, len(units) + 1):
        if not ready.get(kind):
            kind = min((x for x in ready if ready[x]), key=lambda x: ready[x][0][1])
        k = heappop(ready[kind])[2]
        order.append(k)
        then = turn + takes_time[k]
        for j in users[k]:
            missing[j] -= 1
            if known[j] < then:
                known[j] = then
            if not missing[j]:
                heappush(ready.setdefault(kinds[j], []), (known[j] // APART, -hanging[j], j))
    return [units[k] for k in order], [taken[k] for k in order]


def _row(code: int, *rest: int) -> tuple[int, ...]:
    return (code, *rest, *[0] * (5 - len(rest)))
