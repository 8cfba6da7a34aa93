"""What the operations of a graph depend on, and graphs arranged by it."""

from __future__ import annotations

import struct
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from varint.codegen.core import dependence_entries
from varint.codegen.graph import LEAVES, Graph, as_outputs, flat, raise_unless_arranged

_FUSED, _HALVED = struct.Struct("6P3q"), struct.Struct("Pq")  # as in c/dependence_core.c


def needed(graph: Graph) -> list[int]:
    """The nodes that the outputs depend on, in the order of evaluation."""
    live = [False] * len(graph.nodes)
    for output in graph.outputs:
        for i in output:
            live[i] = True
    for i in range(len(live) - 1, -1, -1):
        if live[i] and (node := graph.nodes[i])[0] not in LEAVES:
            for j in node[1:]:
                live[j] = True
    return [i for i, alive in enumerate(live) if alive]


def uniform_nodes(graph: Graph, argument: int) -> list[bool]:
    """Which nodes depend on nothing but the input `argument`."""
    uniform: list[bool] = []
    for node in graph.nodes:
        if node[0] in LEAVES:
            uniform.append(node[0] == "const" or node[1] == argument)
        elif len(node) == 3:
            uniform.append(uniform[node[1]] and uniform[node[2]])
        elif len(node) == 2:
            uniform.append(uniform[node[1]])
        else:
            uniform.append(all(uniform[j] for j in node[1:]))
    return uniform


def operations(graph: Graph, argument: int) -> tuple[int, int]:
    """How many nodes depend on more than the input `argument`, and the square roots among them."""
    return operations_of(graph, needed(graph), uniform_nodes(graph, argument))


def operations_of(graph: Graph, live: list[int], uniform: list[bool]) -> tuple[int, int]:
    """The same of nodes that are live or uniform as `needed` and `uniform_nodes` say."""
    nodes = [i for i in live if not uniform[i]]
    return len(nodes), sum([graph.nodes[i][0] in ("rsqrt", "sqrt") for i in nodes])


def fused(graph: Graph, argument: int) -> Graph:
    """The same with products in sums as one operation that rounds once: ``fma(a, b, c) = a·b + c``,
    ``fms`` = a·b − c, ``fnma`` = c − a·b.

    What depends on nothing but the input `argument` is left as it is.
    """
    made = _Made.beside(graph, graph.outputs)
    answer = dependence_entries()[0](made.asked(argument))
    raise_unless_arranged(answer, len(graph))
    return made.graph()


def halves(graph: Graph, argument: int, constants: int) -> tuple[Graph, Graph]:
    """What does not depend on the input `argument`, and what follows once it is known.

    The first half has the outputs but the last, and one more: what the second takes from it. The
    second half has the inputs (`argument`, taken from the first half, `constants`) and the last
    output. What depends on the constants alone is in both halves.
    """
    made, taken = _Made.beside(graph, graph.outputs[-1:]), np.empty(len(graph), np.int32)
    more = _HALVED.pack(taken.ctypes.data, argument)
    answer = dependence_entries()[1](made.asked(constants) + more)
    raise_unless_arranged(answer, len(graph))
    found = taken[: made.told[1]].tolist()
    return replace(graph, outputs=[*graph.outputs[:-1], found]), made.graph()


class _Made(NamedTuple):
    """A graph that is made of another in C: the other, the outputs that are wanted, their nodes,
    the nodes and numbers of the new one, and how many there are.
    """

    of: Graph
    outputs: list[list[int]]
    wanted: np.ndarray
    rows: np.ndarray
    numbers: np.ndarray
    told: np.ndarray

    @classmethod
    def beside(cls, graph: Graph, outputs: list[list[int]]) -> _Made:
        new = np.empty_like(graph.rows), np.empty_like(graph.numbers), np.zeros(2, np.int64)
        return cls(graph, outputs, flat(outputs), *new)

    def asked(self, same: int) -> bytes:
        """As in c/dependence_core.c."""
        arrays = self.of.rows, self.of.numbers, self.wanted, self.rows, self.numbers, self.told
        counts = len(self.of), len(self.wanted), same
        return _FUSED.pack(*(x.ctypes.data for x in arrays), *counts)

    def graph(self) -> Graph:
        count = self.told[0]
        outputs = as_outputs(self.wanted, [*map(len, self.outputs)])
        return Graph(self.rows[:count].copy(), self.numbers[:count].copy(), outputs)


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
