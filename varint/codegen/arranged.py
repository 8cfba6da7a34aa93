"""The operations of an SX function as they are evaluated over lanes, in C and as a tape."""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca

from varint.codegen.algebra import graph_of
from varint.codegen.dependence import fused, needed, operations, uniform_nodes
from varint.codegen.graph import Graph

if TYPE_CHECKING:
    from varint.codegen.rolled import Forms

WRITTEN_OUT = 20_000  # operations; longer functions become loops over operations of the same form
ROLLED = 0.5  # forms for an operation at most: more are not worth loops


def arranged(f: ca.Function, written_out: int = WRITTEN_OUT, roots: bool = False) -> Graph:
    """The operations of f(x0, …, c) arranged for speed; the last argument is the same in all
    lanes. `roots`: see `graph_of`.
    """
    last = f.n_in() - 1
    graph = graph_of(f, roots=roots)
    # loops add up long sums in an order of their own
    return graph if forms_of(graph, last, written_out) else fused(graph, last)


def forms_of(graph: Graph, last: int, written_out: int) -> Forms | None:
    """The forms of its operations, where they are so many and alike that loops are worth it."""
    if len(graph) <= written_out:
        return None
    count, _ = operations(graph, last)
    if count <= written_out:
        return None
    from varint.codegen.rolled import group_by_form  # few functions are so long

    forms = group_by_form(graph, needed(graph), uniform_nodes(graph, last))
    return forms if len(forms.members) < ROLLED * count else None
