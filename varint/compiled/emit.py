"""C source of an SX function over lanes: every value that varies is a vector `V` of lanes.h."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca

from varint.compiled.algebra import graph_of
from varint.compiled.graph import Graph, needed, operands, uniform_nodes

LONG = 300  # operations from which on a function is not written into its callers: the compiler takes longer, no gain
APART = "static __attribute__((noinline, noclone, unused))"
PIECE = 2500  # operations; a compiler's time for one straight line grows faster than its length
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
    varying = [i for i in live if not uniform[i] and graph.nodes[i][0] not in ("const", "input")]
    piece = {i: k * _pieces(varying) // len(varying) for k, i in enumerate(varying)}
    piece |= {i: piece[first] for first, pair in sincos.items() for i in pair if any(pair)}
    passed = _passed(graph, varying, piece)  # node of one piece that another needs: its place in m
    prepare: list[str] = []
    bodies: list[list[str]] = [[] for _ in range(_pieces(varying))]
    loaded: set[tuple[int, int]] = set()

    def value(i: int, k: int) -> str:
        """The node as an operand of a varying operation in piece k."""
        node = graph.nodes[i]
        if node[0] == "const":
            return _number(node[1])
        if uniform[i]:
            return f"w[{kept.setdefault(i, len(kept))}]"
        if node[0] == "input" and (i, k) not in loaded:
            loaded.add((i, k))
            bodies[k].append(f"const V x{i} = i{node[1]}[{node[2]} * ({stride})];")
        return f"m[{passed[i]}]" if i in passed and piece[i] != k else f"x{i}"

    def once(i: int) -> str:
        return _number(graph.nodes[i][1]) if graph.nodes[i][0] == "const" else names[i]

    for i in live:
        node = graph.nodes[i]
        if uniform[i] and node[0] != "const":
            names[i] = f"s{i}"
            prepare.append(f"const double {names[i]} = {_once(node, once)};")
        if i not in piece:
            continue
        k, made = piece[i], [i]
        if i in sincos:
            if not any(sincos[i]):
                continue
            made = list(sincos[i])
            angle = value(node[1], k)
            bodies[k].append(f"V x{made[0]}, x{made[1]}; v_sincos({angle}, &x{made[0]}, &x{made[1]});")
        else:
            text = _varying(graph, node, lambda j, k=k: value(j, k), uniform)
            bodies[k].append(f"const V x{i} = {text};")
        bodies[k] += [f"m[{passed[j]}] = x{j};" for j in made if j in passed]
    for k, output in enumerate(graph.outputs):
        for r, i in enumerate(output):
            where = piece.get(i, 0)
            text = value(i, where)
            text = f"splat({text})" if graph.nodes[i][0] == "const" or uniform[i] else text
            bodies[where].append(f"o{k}[{r} * ({stride})] = {text};")
    prepare += [f"w[{place}] = {names[i]};" for i, place in kept.items()]
    arguments = [f"const V *i{k}" for k in range(last)] + ["const double *w"]
    arguments += [f"V *restrict o{k}" for k in range(f.n_out())]
    source = "\n    ".join(
        [f"INLINE void {name}_prepare(const double *c, double *w) {{", "(void)c, (void)w;", *prepare]
    )
    source += "\n}\n" + _function(name, arguments, bodies, len(passed))
    roots = sum(1 for i in live if graph.nodes[i][0] in ("rsqrt", "sqrt") and not uniform[i])
    return Emitted(source, len(kept), sum(map(len, bodies)), roots)


def _pieces(varying: list[int]) -> int:
    return max(-(-len(varying) // PIECE), 1)


def _passed(graph: Graph, varying: list[int], piece: dict[int, int]) -> dict[int, int]:
    """Nodes that are needed in another piece than their own, numbered."""
    found: dict[int, int] = {}
    for i in varying:
        for j in operands(graph.nodes[i]):
            if piece.get(j, piece[i]) != piece[i]:
                found.setdefault(j, len(found))
    return found


def _function(name: str, arguments: list[str], bodies: list[list[str]], passed: int) -> str:
    """The C function, in one piece or as a sequence of functions that hand values on through m."""
    named = [a.split("*")[-1].split()[-1] for a in arguments]
    unused = " ".join(f"(void){x};" for x in named)
    if len(bodies) == 1:
        kind = "INLINE" if len(bodies[0]) <= LONG else APART
        return "\n    ".join([f"{kind} void {name}({', '.join(arguments)}) {{", unused, *bodies[0]]) + "\n}\n"
    source = ""
    for k, body in enumerate(bodies):
        head = f"{APART} void {name}_{k}({', '.join([*arguments, 'V *restrict m'])}) {{"
        source += "\n    ".join([head, unused, *body]) + "\n}\n"
    calls = [f"{name}_{k}({', '.join([*named, 'm'])});" for k in range(len(bodies))]
    top = [f"INLINE void {name}({', '.join(arguments)}) {{", f"V m[{passed}];"]
    return source + "\n    ".join([*top, *calls]) + "\n}\n"


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
