"""C source of an SX function over lanes: every value that varies is a vector `V` of lanes.h."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca

from varint.codegen.angles import with_angles_together
from varint.codegen.arranged import WRITTEN_OUT, arranged, forms_of
from varint.codegen.dependence import needed, operations_of, sine_and_cosine, uniform_nodes
from varint.codegen.graph import Graph
from varint.codegen.parts import LARGEST, Statement
from varint.codegen.pieces import (
    APART,
    Pieces,
    c_function,
    in_blocks,
    in_parts,
    repeats_of,
    worth_it,
)
from varint.codegen.prepared import PreparedNumbers
from varint.codegen.rolled import c_expression, c_loops

# operations from which on a function is not written into its callers: the compiler takes longer, no
# gain
LONG = 300


@dataclass(frozen=True)
class Emitted:
    """C source of a function and what the loop around it must know.

    Attributes
    ----------
    source : str
        ``name(inputs…, w, outputs…)`` over lanes, and ``name_prepare(c, w)``, to be called once a
        run.
    uniforms : int
        Length of w: values that depend on the parameters alone.
    operations, roots : int
        Operations a call, and the square roots among them.
    length, largest : int
        Statements of the source, fewer than operations where they are loops, and most of them in
        one C function.
    """

    source: str
    uniforms: int
    operations: int
    roots: int
    length: int
    largest: int


def emit(name: str, f: ca.Function, stride: str = "1", written_out: int = WRITTEN_OUT) -> Emitted:
    """C source of the SX function f(x0, …, c), whose last argument c, the parameters, is the same
    in all lanes.

    Sparse outputs are written densely; see `emit_graph`.
    """
    return emit_graph(name, arranged(f, written_out), f.n_in() - 1, stride, written_out)


def emit_graph(
    name: str,
    graph: Graph,
    last: int,
    stride: str = "1",
    written_out: int = WRITTEN_OUT,
    shared: PreparedNumbers | None = None,
    fewest: int = 0,
    rare: bool = False,
) -> Emitted:
    """C source of operations on inputs 0 to `last`, the last of which is the same in all lanes.

    Parameters
    ----------
    name : str
        Name of the C function ``name(const V *x0, …, const double *w, V *y0, …)``.
    graph : Graph
    last : int
    stride : str
        C expression: component i of an argument is found at ``x[i * stride]``.
    written_out : int
        Operations from which on the source has loops over operations of the same form.
    shared : PreparedNumbers, optional
        What w has for several functions, one point each; the caller writes what prepares it.
    fewest : int
        Angles whose sines and cosines are asked for by one call of ``sines_and_cosines(w, angles,
        sines, cosines)``, so many at least; 0: each by itself.
    rare : bool
        Whether the function is called so seldom that to compile it takes longer than it does.
    """
    prepared = PreparedNumbers() if shared is None else shared
    uniform = uniform_nodes(graph, last)
    live = needed(graph)
    names = prepared.enter(graph, live, uniform)

    def place(i: int) -> int:
        return prepared.place(names[i])

    def constant(i: int) -> str:
        return names[i] if graph.nodes[i][0] == "const" else f"w[{place(i)}]"

    count, roots = operations_of(graph, live, uniform)
    forms = forms_of(graph, last, written_out)
    statements: list[Statement] = []
    if forms:
        body, places = c_loops(forms, stride, constant, place)
    else:
        statements = _statements(graph, live, uniform, stride, constant)
        if fewest:
            statements = with_angles_together(statements, fewest)
        body, places = [x.text for x in statements], {}
    stores: list[Statement] = []
    for k, output in enumerate(graph.outputs):
        for r, i in enumerate(output):
            if uniform[i]:
                text = f"splat({constant(i)})"
            elif forms and graph.nodes[i][0] == "input":
                text = f"i{graph.nodes[i][1]}[{graph.nodes[i][2]} * ({stride})]"
            else:
                text = places.get(i, f"x{i}")
            store = f"o{k}[{r} * ({stride})] = {text};"
            stores.append(Statement(store, (), () if uniform[i] else (i,)))
    body += [store.text for store in stores]
    arguments = [f"const V *i{k}" for k in range(last)] + ["const double *w"]
    arguments += [f"V *restrict o{k}" for k in range(len(graph.outputs))]
    if forms or len(body) <= LARGEST:
        pieces = Pieces("", body, len(body), len(body), len(body))
    else:
        parts = in_parts(name, statements, stores, arguments)
        found = repeats_of(graph, live, uniform)
        blocks = found and in_blocks(name, found, arguments, stride, constant, place)
        pieces = blocks if blocks and worth_it(blocks, parts) else parts
    kind = "RARE" if rare else "INLINE" if len(body) <= LONG else APART
    whole = c_function(kind, name, arguments, pieces.body)
    source = pieces.before + whole
    if shared is not None:
        return Emitted(source, 0, count, roots, pieces.length, pieces.largest)
    source = prepared.source(name) + source
    return Emitted(source, len(prepared), count, roots, pieces.length, pieces.largest)


def _statements(
    graph: Graph, live: list[int], uniform: list[bool], stride: str, constant: Callable[[int], str]
) -> list[Statement]:
    """One C statement for each value that varies, which is called x and its number."""
    sincos = sine_and_cosine(graph, live, uniform)
    result = []

    def value(i: int) -> str:
        return constant(i) if uniform[i] else f"x{i}"

    for i in live:
        name, *rest = graph.nodes[i]
        if uniform[i]:
            continue
        if name == "input":
            text = f"const V x{i} = i{rest[0]}[{rest[1]} * ({stride})];"
            result.append(Statement(text, (i,), (), is_input=True))
        elif i not in sincos:
            text = c_expression(name, [value(j) for j in rest], [uniform[j] for j in rest])
            taken = tuple(dict.fromkeys(j for j in rest if not uniform[j]))
            result.append(Statement(f"const V x{i} = {text};", (i,), taken))
        elif sincos[i][0]:
            sine, cosine = sincos[i]
            text = f"V x{sine}, x{cosine}; v_sincos({value(rest[0])}, &x{sine}, &x{cosine});"
            result.append(Statement(text, (sine, cosine), (rest[0],)))
    return result
