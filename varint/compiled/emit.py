"""C source of an SX function over lanes: every value that varies is a vector `V` of lanes.h."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca

from varint.compiled.algebra import graph_of
from varint.compiled.graph import Graph, needed, uniform_nodes

LONG = 300  # operations from which on a function is not written into its callers: the compiler takes longer, no gain
_INFIX = {"add": "+", "sub": "-", "mul": "*", "div": "/"}


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
        Operations a call, and the reciprocal square roots among them.
    """

    source: str
    uniforms: int
    operations: int
    roots: int


def emit(name: str, f: ca.Function, stride: str = "1") -> Emitted:
    """C source of the SX function f(x0, …, c), whose last argument c, the parameters, is the same in all lanes.

    Parameters
    ----------
    name : str
        Name of the C function ``name(const V *x0, …, const double *w, V *y0, …)``.
    f : Function
        SX function; sparse outputs are written densely.
    stride : str
        C expression: component i of an argument is found at ``x[i * stride]``.
    """
    graph = graph_of(f)
    last = f.n_in() - 1
    uniform = uniform_nodes(graph, last)
    live = sorted(needed(graph))
    sincos = _sine_and_cosine(graph, live, uniform)
    names: dict[int, str] = {}
    kept: dict[int, int] = {}  # uniform node: its place in w
    prepare, body = [], []

    def value(i: int) -> str:
        """The node as an operand of a varying operation."""
        if graph.nodes[i][0] == "const":
            return _number(graph.nodes[i][1])
        if uniform[i]:
            return f"w[{kept.setdefault(i, len(kept))}]"
        return names[i]

    def once(i: int) -> str:
        return _number(graph.nodes[i][1]) if graph.nodes[i][0] == "const" else names[i]

    for i in live:
        node = graph.nodes[i]
        if node[0] == "const":
            continue
        names[i] = f"{'s' if uniform[i] else 'x'}{i}"
        if uniform[i]:
            prepare.append(f"const double {names[i]} = {_once(node, once)};")
        elif node[0] == "input":
            body.append(f"const V {names[i]} = i{node[1]}[{node[2]} * ({stride})];")
        elif i in sincos:
            pair = sincos[i]
            if pair[0]:
                sine, cosine = pair
                names[sine], names[cosine] = f"x{sine}", f"x{cosine}"
                body.append(f"V x{sine}, x{cosine}; v_sincos({value(node[1])}, &x{sine}, &x{cosine});")
        else:
            body.append(f"const V {names[i]} = {_varying(graph, node, value, uniform)};")
    for k, output in enumerate(graph.outputs):
        for r, i in enumerate(output):
            text = f"splat({value(i)})" if graph.nodes[i][0] == "const" or uniform[i] else names[i]
            body.append(f"o{k}[{r} * ({stride})] = {text};")
    prepare += [f"w[{place}] = {names[i]};" for i, place in kept.items()]
    arguments = [f"const V *i{k}" for k in range(last)] + ["const double *w"]
    arguments += [f"V *restrict o{k}" for k in range(f.n_out())]
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
    return Emitted(source, len(kept), len(body), roots)


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


def _once(node: tuple, value) -> str:
    if node[0] == "input":
        return f"c[{node[2]}]"
    if node[0] == "neg":
        return f"-{value(node[1])}"
    if node[0] in _INFIX:
        return f"{value(node[1])} {_INFIX[node[0]]} {value(node[2])}"
    return f"s_{node[0]}({', '.join(value(j) for j in node[1:])})"


def _varying(graph: Graph, node: tuple, value, uniform: list[bool]) -> str:
    if node[0] == "neg":
        return f"-{value(node[1])}"
    if node[0] in _INFIX:
        return f"{value(node[1])} {_INFIX[node[0]]} {value(node[2])}"
    arguments = (f"splat({value(j)})" if uniform[j] else value(j) for j in node[1:])
    return f"v_{node[0]}({', '.join(arguments)})"


def _number(x: float) -> str:
    if math.isfinite(x):
        return f"({float(x)!r})" if x < 0 else repr(float(x))
    return "(0.0 / 0.0)" if math.isnan(x) else ("(1.0 / 0.0)" if x > 0 else "(-1.0 / 0.0)")
