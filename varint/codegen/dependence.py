"""What the operations of a graph depend on, and graphs arranged by it."""

from __future__ import annotations

from itertools import chain

from varint.codegen.graph import LEAVES, Graph, operands

_SUMS = frozenset(("add", "sub"))


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
    uniform = uniform_nodes(graph, argument)
    nodes = [i for i in needed(graph) if not uniform[i]]
    return len(nodes), sum([graph.nodes[i][0] in ("rsqrt", "sqrt") for i in nodes])


def fused(graph: Graph, argument: int) -> Graph:
    """The same with products in sums as one operation that rounds once: ``fma(a, b, c) = a·b + c``,
    ``fms`` = a·b − c, ``fnma`` = c − a·b.

    What depends on nothing but the input `argument` is left as it is.
    """
    uniform, live, nodes = uniform_nodes(graph, argument), needed(graph), graph.nodes
    elsewhere = set[int]()  # products that not sums alone take, once it is asked
    found, places = list[tuple](), [0] * len(nodes)  # in the same order, and different ones as well
    for i in live:
        node = nodes[i]
        name = node[0]
        places[i] = len(found)
        if name in LEAVES:
            found.append(node)
        elif len(node) == 2:
            found.append((name, places[node[1]]))
        elif name not in _SUMS:
            found.append((name, places[node[1]], places[node[2]]))
        else:
            _, a, b = node
            first = nodes[a][0] == "mul" and not uniform[a]
            if nodes[b][0] == "mul" and not uniform[b]:
                if first:
                    elsewhere = elsewhere or _elsewhere(graph, live)
                    first = b in elsewhere and a not in elsewhere
            elif not first:
                found.append((name, places[a], places[b]))
                continue
            kind = "fma" if name == "add" else "fms" if first else "fnma"
            product, other = (a, b) if first else (b, a)
            _, x, y = nodes[product]
            found.append((kind, places[x], places[y], places[other]))
    outputs = [[places[i] for i in output] for output in graph.outputs]
    return Graph(found, dict(zip(found, range(len(found)), strict=True)), outputs)


def _elsewhere(graph: Graph, live: list[int]) -> set[int]:
    """What is used, and not in sums alone."""
    others = (node for i in live if (node := graph.nodes[i])[0] not in _SUMS)
    return set(chain(*graph.outputs, *(operands(node) for node in others)))


def halves(graph: Graph, argument: int, constants: int) -> tuple[Graph, Graph]:
    """What does not depend on the input `argument`, and what follows once it is known.

    The first half has the outputs but the last, and one more: what the second takes from it. The
    second half has the inputs (`argument`, taken from the first half, `constants`) and the last
    output. What depends on the constants alone is in both halves.
    """
    late = [False] * len(graph.nodes)
    for i, node in enumerate(graph.nodes):
        late[i] = node[:2] == ("input", argument) or any(late[j] for j in operands(node))
    uniform = uniform_nodes(graph, constants)
    wanted: set[int] = set()
    waiting = list(graph.outputs[-1])
    while waiting:
        i = waiting.pop()
        if i not in wanted:
            wanted.add(i)
            waiting += operands(graph.nodes[i]) if late[i] or uniform[i] else ()
    second, taken, places = Graph(), list[int](), dict[int, int]()
    for i in sorted(wanted):
        name, *rest = graph.nodes[i]
        if name == "const":
            places[i] = second.node(name, *rest)
        elif not (late[i] or uniform[i]):
            places[i] = second.node("input", 1, len(taken))
            taken.append(i)
        elif name == "input":
            places[i] = second.node(name, 0 if late[i] else 2, rest[1])
        else:
            places[i] = second.node(name, *(places[j] for j in rest))
    second.outputs = [[places[i] for i in graph.outputs[-1]]]
    return Graph(graph.nodes, graph.index, [*graph.outputs[:-1], taken]), second


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
