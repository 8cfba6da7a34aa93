"""The functions of a scene arranged for speed: as graphs, which become C, and as tapes, which are
data and kept on the disk.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import casadi as ca

from varint.codegen.algebra import graph_of
from varint.codegen.arranged import WRITTEN_OUT, arranged
from varint.codegen.dependence import fused, halves, operations
from varint.codegen.graph import Graph, NotCompilable
from varint.codegen.kept import KEPT_FROM, keep_tapes, kept_tapes, key_of
from varint.codegen.tape import Sizes, Tape, tape_of, with_many_roots

MOST_OPERATIONS = 1_000_000  # of a right-hand side: more takes too long to arrange


@dataclass(eq=False)
class Arrangement:
    """Functions that are arranged together, once they are asked for.

    Attributes
    ----------
    key : str
        Of all that they are made from; empty where they are too short to be kept.
    last : dict
        For each function the index of its last input, which is the same all the time.
    arrange : callable
        What arranges them.
    """

    key: str
    last: dict[str, int]
    arrange: Callable[[], dict[str, Graph]]

    @cached_property
    def _arranged(self) -> dict[str, Graph] | str:
        """The graphs, or why there are none: what was found too long is not examined again."""
        try:
            return self.arrange()
        except NotCompilable as refusal:
            return str(refusal)

    @property
    def graphs(self) -> dict[str, Graph]:
        """The functions as graphs; raises NotCompilable."""
        if isinstance(self._arranged, str):
            raise NotCompilable(self._arranged)
        return self._arranged

    @cached_property
    def kept(self) -> dict[str, Tape]:
        """The tapes that an earlier process has kept; none where there is none."""
        return kept_tapes(self.key, [*self.last]) if self.key else {}

    @cached_property
    def sizes(self) -> dict[str, Sizes]:
        """Of each function; raises NotCompilable."""
        made = self.kept or self.__dict__.get("tapes")
        if made:
            return {name: tape.sizes for name, tape in made.items()}
        return {
            name: Sizes(len(graph), *operations(graph, self.last[name]))
            for name, graph in self.graphs.items()
        }

    @cached_property
    def tapes(self) -> dict[str, Tape]:
        """The functions as tapes of few roots; raises NotCompilable."""
        if self.kept:
            return self.kept
        made = {name: tape_of(graph, self.last[name]) for name, graph in self.graphs.items()}
        if self.key:
            keep_tapes(self.key, made)
        return made


class Routine(NamedTuple):
    """One of the functions that are arranged together, on inputs 0 to `last`, the last of which is
    the same all the time.
    """

    arrangement: Arrangement
    name: str

    @property
    def last(self) -> int:
        return self.arrangement.last[self.name]

    @property
    def graph(self) -> Graph:
        return self.arrangement.graphs[self.name]

    @property
    def sizes(self) -> Sizes:
        return self.arrangement.sizes[self.name]

    @property
    def nodes(self) -> int:
        """Of the graph; more are not looked at than is necessary to tell."""
        kept = self.arrangement.kept
        return kept[self.name].sizes.nodes if kept else len(self.graph)

    def tape(self, many_roots: bool) -> Tape:
        """As data; `many_roots`: roots count by their number, not by their latency."""
        found = self.arrangement.tapes[self.name]
        return with_many_roots(found) if many_roots else found


Expressions = Mapping[str, tuple[list[ca.SX], list[ca.SX]]]


def routines(
    constants: ca.SX,
    expressions: Expressions,
    written_out: int = WRITTEN_OUT,
    roots: bool = False,
) -> dict[str, Routine]:
    """Functions by name from (inputs, outputs); `constants`, the same all the time, are appended
    to the inputs. Arranging them raises NotCompilable where they are too long. `roots`: see
    `graph_of`.
    """
    whole = {
        name: _function(name, [*x, constants], outputs)
        for name, (x, outputs) in expressions.items()
    }

    def arrange() -> dict[str, Graph]:
        return {name: arranged(_short(f), written_out, roots) for name, f in whole.items()}

    return _together(f"routines {written_out} {roots}", whole, arrange)


def halved(
    constants: ca.SX,
    names: tuple[str, str],
    inputs: list[ca.SX],
    late: ca.SX,
    outputs: list[ca.SX],
) -> dict[str, Routine]:
    """Two functions: the outputs but the last, and what the second takes from the first; then the
    last output, once `late` is known: ``second(late, taken, w, output)``.
    """
    last = len(inputs)  # of the first half: what it has besides the inputs are the constants
    whole = _function(names[0], [*inputs, constants, late], outputs)

    def arrange() -> dict[str, Graph]:
        graph = graph_of(_short(whole), last)
        first, second = halves(graph, last + 1, last)
        return {names[0]: fused(first, last), names[1]: fused(second, 2)}

    return _together("halved", {names[0]: whole}, arrange, dict(zip(names, (last, 2), strict=True)))


def _together(
    kind: str,
    functions: Mapping[str, ca.Function],
    arrange: Callable[[], dict[str, Graph]],
    last: dict[str, int] | None = None,
) -> dict[str, Routine]:
    last = last or {name: f.n_in() - 1 for name, f in functions.items()}
    long = sum(f.n_instructions() for f in functions.values()) >= KEPT_FROM
    key = key_of(kind, *(f.serialize() for f in functions.values())) if long else ""
    whole = Arrangement(key, last, arrange)
    return {name: Routine(whole, name) for name in last}


def _function(name: str, inputs: list[ca.SX], outputs: list[ca.SX]) -> ca.Function:
    """To be read; equal operations become one where they are arranged."""
    outputs = [ca.densify(x) for x in outputs]
    return ca.Function(name, inputs, outputs, {"live_variables": False})


def _short(f: ca.Function) -> ca.Function:
    """Itself; raises NotCompilable where it is too long."""
    if f.n_instructions() > MOST_OPERATIONS:
        raise NotCompilable(
            f"{f.name()} has {f.n_instructions()} operations, more than {MOST_OPERATIONS}; use "
            'backend="interpreted", or fewer coordinates'
        )
    return f
