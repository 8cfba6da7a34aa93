"""Long graphs as blocks that repeat: what is done for every link of a machine is found again and
again, and needs to be written once.

Operations with the same first and last component of the arguments that they depend on, and of the
outputs that depend on them, belong together: in a recursion over links these are the operations of
one link in one direction. On any way from operation to operation the components reach further
before and less far behind, so that no value leaves a block and comes back.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Hashable, Iterable, Iterator, Sequence

from varint.codegen.graph import COMMUTATIVE, Graph

FEW = 8  # operations of a block that is made part of another one
PRODUCTS = ("fma", "fms", "fnma")  # whose first two operands may be exchanged
Unit = tuple[int, ...]  # an operation, or the sine and the cosine of an angle
Block = tuple[Unit, ...]


Reach = tuple[float, float]  # the first and the last component
NOTHING: Reach = (math.inf, -math.inf)


def _wider(reaches: Iterable[Reach]) -> Reach:
    """What all reach, and what lies between."""
    low, high = NOTHING
    for first, last in reaches:
        low, high = min(low, first), max(high, last)
    return low, high


class Repeats:
    """The operations of a graph in blocks, in an order of evaluation.

    Attributes
    ----------
    order : list of Block
    shapes : list of int
        Equal numbers for blocks that differ in places and numbers alone.
    stored : dict
        Node → the outputs it is, as (output, row).
    """

    def __init__(self, graph: Graph, units: Sequence[Unit], uniform: Sequence[bool]) -> None:
        self.graph, self.uniform = graph, uniform
        self.known: dict[Hashable, int] = {}
        self.taken: dict[Unit, tuple[int, ...]] = {
            unit: tuple(graph.nodes[unit[0]][1:]) for unit in units
        }
        self.stored: dict[int, list[tuple[int, int]]] = defaultdict(list)
        for k, output in enumerate(graph.outputs):
            for row, i in enumerate(output):
                self.stored[i].append((k, row))
        blocks = self._with_few(self._split(units))
        self.order = self._evaluated([self._in_form(block) for block in blocks])
        self.shapes = [self.shape(block) for block in self.order]

    def varying(self, i: int) -> bool:
        """Is node i an operation, whose value is not the same all the time?"""
        return not self.uniform[i] and self.graph.nodes[i][0] != "input"

    def label(self, key: Hashable) -> int:
        """The same number for the same key."""
        return self.known.setdefault(key, len(self.known))

    def _split(self, units: Sequence[Unit]) -> list[list[Unit]]:
        """Units by the first and the last component of the arguments that they depend on, and of
        the outputs that depend on them, in the order of evaluation.

        Only what is as long as the first argument counts, the coordinates: other arrays are in no
        order of the scene's.
        """
        nodes = self.graph.nodes
        last: dict[int, int] = defaultdict(int)  # component of every argument
        for node in nodes:
            if node[0] == "input":
                last[node[1]] = max(last[node[1]], node[2])
        before: dict[int, Reach] = {}
        after: dict[int, Reach] = {}
        for i, node in enumerate(nodes):
            if node[0] == "input":
                before[i] = (node[2], node[2]) if last[node[1]] == last[0] else NOTHING
        for unit in units:
            seen = _wider(before.get(j, NOTHING) for j in self.taken[unit])
            before |= dict.fromkeys(unit, seen)
        for i, places in self.stored.items():
            after[i] = _wider(
                (row, row) for k, row in places if len(self.graph.outputs[k]) == 1 + last[0]
            )
        found: dict[tuple[Reach, Reach], list[Unit]] = defaultdict(list)
        for unit in reversed(units):
            use = _wider(after.get(i, NOTHING) for i in unit)
            for j in self.taken[unit]:
                after[j] = _wider((after.get(j, NOTHING), use))
            found[before[unit[0]], use].append(unit)
        return [block[::-1] for block in reversed(found.values())]

    def _with_few(self, blocks: list[list[Unit]]) -> list[list[Unit]]:
        """Short blocks as part of the only longer one that takes what they make, or makes what
        they take.
        """
        home = {i: k for k, block in enumerate(blocks) for unit in block for i in unit}
        takers: list[set[int]] = [set() for _ in blocks]
        makers: list[set[int]] = [set() for _ in blocks]
        for k, block in enumerate(blocks):
            makers[k] = {home[j] for unit in block for j in self.taken[unit] if j in home} - {k}
            for m in makers[k]:
                takers[m].add(k)
        for k, block in enumerate(blocks):
            for others, after in ((takers[k], True), (makers[k], False)):
                other = min(others, default=k) if len(others) == 1 else k
                if 0 < len(blocks[k]) <= FEW < len(blocks[other]):
                    blocks[other] = block + blocks[other] if after else blocks[other] + block
                    blocks[k] = []
        return [block for block in blocks if block]

    def _in_form(self, block: Sequence[Unit]) -> Block:
        """The block's units in an order that depends on its form alone, and their operands."""
        within = {i: unit for unit in block for i in unit}
        past: dict[int, int] = {}  # node → label of what it is made of
        depth: dict[Unit, int] = {}
        for unit in block:
            for j in self.taken[unit]:
                past.setdefault(j, self.label(self._kind(j)))
            depth[unit] = 1 + max(
                (depth[within[j]] for j in self.taken[unit] if j in within), default=0
            )
            name = self.graph.nodes[unit[0]][0]
            made = tuple(tuple(sorted(past[j] for j in part)) for part in self._parts(unit))
            ends = tuple(tuple(k for k, _ in self.stored.get(i, ())) for i in unit)
            for n, i in enumerate(unit):
                past[i] = self.label((name, len(unit), n, made, ends))
        future: dict[int, list[tuple[int, int]]] = defaultdict(list)
        full: dict[int, int] = {}

        def whole(i: int) -> int:
            if i not in full:
                full[i] = self.label((past[i], tuple(sorted(future[i]))))
            return full[i]

        for unit in reversed(block):
            use = self.label(tuple(whole(i) for i in unit))
            for n, part in enumerate(self._parts(unit)):
                for j in part:
                    future[j].append((use, n))
        for unit in block:
            self.taken[unit] = tuple(
                j for part in self._parts(unit) for j in sorted(part, key=whole)
            )
        return tuple(sorted(block, key=lambda unit: (depth[unit], [whole(i) for i in unit])))

    def _parts(self, unit: Unit) -> list[tuple[int, ...]]:
        """The operands of a unit; those that may be exchanged together."""
        name, taken = self.graph.nodes[unit[0]][0], self.taken[unit]
        if name in COMMUTATIVE:
            return [taken]
        if name in PRODUCTS:
            return [taken[:2], taken[2:]]
        return [(j,) for j in taken]

    def _kind(self, i: int) -> tuple:
        """Where a value from outside a block comes from."""
        name, *rest = self.graph.nodes[i]
        if name == "const":
            return ("number",)
        if self.uniform[i]:
            return ("same",)
        return ("input", rest[0]) if name == "input" else ("value",)

    def shape(self, block: Block) -> int:
        """A number for the block's form."""
        places: dict[int, int] = {}
        form: list[tuple] = []
        for unit in block:
            taken: list[Hashable] = []
            for j in self.taken[unit]:
                if self.uniform[j]:
                    taken.append(self._kind(j))
                else:
                    known = j in places
                    place = places.setdefault(j, len(places))
                    taken.append(place if known else (place, self._kind(j)))
            for i in unit:
                places[i] = len(places)
            ends = tuple(tuple(k for k, _ in self.stored.get(i, ())) for i in unit)
            form.append((self.graph.nodes[unit[0]][0], len(unit), tuple(taken), ends))
        return self.label(tuple(form))

    def _evaluated(self, blocks: Sequence[Block]) -> list[Block]:
        """The blocks in an order of evaluation, each as late as the next that needs it allows."""
        home = {i: k for k, block in enumerate(blocks) for unit in block for i in unit}
        waiting: list[tuple[int, Iterator[int]]] = []
        done: dict[int, Block] = {}
        for last in range(len(blocks)):
            waiting.append((last, iter((last,))))
            while waiting:
                k, needed = waiting[-1]
                following = next((j for j in needed if j not in done), None)
                if following is None:
                    waiting.pop()
                    done[k] = blocks[k]
                else:
                    waiting.append((following, self._needed(blocks[following], home, following)))
        return list(done.values())

    def _needed(self, block: Block, home: dict[int, int], own: int) -> Iterator[int]:
        taken = (j for unit in block for j in self.taken[unit] if self.varying(j))
        return (home[j] for j in taken if home[j] != own)

    def written(self) -> int:
        """Operations of the blocks, those of one form counted once."""
        sizes = zip(self.shapes, map(len, self.order), strict=True)
        return sum(dict(sizes).values())
