"""C source of an SX function over lanes: every value that varies is a vector `V` of lanes.h."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca

from varint.compiled.algebra import graph_of
from varint.compiled.graph import Graph, needed, uniform_nodes
from varint.compiled.rolled import INFIX, loops, sorted_by_form, written

LONG = 300  # operations from which on a function is not written into its callers: the compiler takes longer, no gain
WRITTEN_OUT = 20_000  # operations; longer functions become loops over operations of the same form


@dataclass(frozen=True)
class Emitted:
    """C source of a function and what the loop around it must know.

    Attributes
    ----------
    source : str
        ``name(inputs…, w, outputs…)`` over lanes, and ``name_prepare(c, w)``, to be called once a run.
    uniforms : int
        Length of w: values that depend on the parameters alone.
    operations, roots : int
        Operations a call, and the square roots among them.
    length : int
        Statements of the source, fewer than operations where they are loops.
    """

    source: str
    uniforms: int
    operations: int
    roots: int
    length: int


def emit(name: str, f: ca.Function, stride: str = "1", written_out: int = WRITTEN_OUT) -> Emitted:
    """C source of the SX function f(x0, …, c), whose last argument c, the parameters, is the same in all lanes.

    Sparse outputs are written densely; see `emit_graph`.
    """
    return emit_graph(name, graph_of(f), f.n_in() - 1, stride, written_out)


def emit_graph(name: str, graph: Graph, last: int, stride: str = "1", written_out: int = WRITTEN_OUT) -> Emitted:
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
    """
    uniform = uniform_nodes(graph, last)
    live = sorted(needed(graph))
    names = {i: f"s{i}" for i in live if uniform[i] and graph.nodes[i][0] != "const"}
    kept: dict[int, int] = {}  # uniform node: its place in w

    def place(i: int) -> int:
        return kept.setdefault(i, len(kept))

    def constant(i: int) -> str:
        return _number(graph.nodes[i][1]) if graph.nodes[i][0] == "const" else f"w[{place(i)}]"

    def once(i: int) -> str:
        return names.get(i) or constant(i)

    prepare = [f"const double {names[i]} = {_once(graph.nodes[i], once)};" for i in live if i in names]
    operations = sum(not uniform[i] for i in live)
    if operations > written_out:
        body, places = loops(sorted_by_form(graph, live, uniform), stride, constant, place)
    else:
        body, places = _statements(graph, live, uniform, stride, constant)
    for k, output in enumerate(graph.outputs):
        for r, i in enumerate(output):
            if uniform[i]:
                text = f"splat({constant(i)})"
            else:
                text = places.get(i) or f"i{graph.nodes[i][1]}[{graph.nodes[i][2]} * ({stride})]"
            body.append(f"o{k}[{r} * ({stride})] = {text};")
    prepare += [f"w[{place}] = {names[i]};" for i, place in kept.items()]
    arguments = [f"const V *i{k}" for k in range(last)] + ["const double *w"]
    arguments += [f"V *restrict o{k}" for k in range(len(graph.outputs))]
    source = "\n    ".join(
        [f"INLINE void {name}_prepare(const double *c, double *w) {{", "(void)c, (void)w;", *prepare]
    )
    kind = "INLINE" if len(body) <= LONG else "static __attribute__((noinline, noclone, unused))"
    unused = " ".join(f"(void)i{k};" for k in range(last))
    source += (
        "\n}\n"
        + "\n    ".join([f"{kind} void {name}({', '.join(arguments)}) {{", f"{unused} (void)w;", *body])
        + "\n}\n"
    )
    roots = sum(1 for i in live if graph.nodes[i][0] in ("rsqrt", "sqrt") and not uniform[i])
    return Emitted(source, len(kept), operations, roots, len(body))


def _statements(
    graph: Graph, live: list[int], uniform: list[bool], stride: str, constant: Callable[[int], str]
) -> tuple[list[str], dict[int, str]]:
    """One C statement for each value that varies, and its name."""
    sincos = _sine_and_cosine(graph, live, uniform)
    body, names = [], {i: f"x{i}" for i in live if not uniform[i]}

    def value(i: int) -> str:
        return names.get(i) or constant(i)

    for i in names:
        name, *rest = graph.nodes[i]
        if name == "input":
            body.append(f"const V {names[i]} = i{rest[0]}[{rest[1]} * ({stride})];")
        elif i not in sincos:
            text = written(name, [value(j) for j in rest], [uniform[j] for j in rest])
            body.append(f"const V {names[i]} = {text};")
        elif sincos[i][0]:
            sine, cosine = (names[j] for j in sincos[i])
            body.append(f"V {sine}, {cosine}; v_sincos({value(rest[0])}, &{sine}, &{cosine});")
    return body, names


def _sine_and_cosine(graph: Graph, live: list[int], uniform: list[bool]) -> dict[int, tuple[int, int]]:
    """For each node that belongs to a sine and cosine of one angle: the pair at the first, (0, 0) at the second."""
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


def _once(node: tuple, value: Callable[[int], str]) -> str:
    """C expression of an operation on plain numbers."""
    if node[0] == "input":
        return f"c[{node[2]}]"
    if node[0] in INFIX or node[0] == "neg":
        return written(node[0], [value(j) for j in node[1:]], [True] * (len(node) - 1))
    return f"s_{node[0]}({', '.join(value(j) for j in node[1:])})"


def _number(x: float) -> str:
    if math.isfinite(x):
        return f"({float(x)!r})" if x < 0 else repr(float(x))
    return "(0.0 / 0.0)" if math.isnan(x) else ("(1.0 / 0.0)" if x > 0 else "(-1.0 / 0.0)")
