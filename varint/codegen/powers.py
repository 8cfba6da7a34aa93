"""Powers of a graph's nodes by whole numbers of quarters."""

from __future__ import annotations

from varint.codegen.graph import Graph, whole_power

Powers = tuple[tuple[int, int], ...]  # nodes and their exponents, in quarters


def has_root(quarters: int) -> bool:
    """Is √(x^e) = x^(e/2) wherever x^e ≥ 0, and a power of quarters?"""
    return quarters % 2 == 0 and quarters % 8 != 0


def joined(powers: Powers, more: Powers) -> Powers:
    """The powers of a product."""
    if not powers or not more:
        return powers or more
    total = dict(powers)
    for base, e in more:
        total[base] = total.get(base, 0) + e
    return tuple(sorted([power for power in total.items() if power[1]]))


def inverse(powers: Powers) -> Powers:
    """The powers of 1 over a product."""
    return tuple([(base, -e) for base, e in powers]) if powers else powers


def power_of(graph: Graph, base: int, exponent: int, kind: str) -> int:
    """base^(exponent / 4), by products, roots, and the reciprocal that the kind says."""
    if exponent == 4:
        return base
    if exponent < 0 and kind == "inverse":
        return power_of(graph, graph.node("div", graph.one, base), -exponent, "")
    quarters = abs(exponent)
    # two roots side by side
    parts = [graph.node("sqrt", graph.node("sqrt", base))] if quarters & 1 else []
    inverse_root = (
        graph.node("rsqrt", base) if kind == "root" and (quarters & 2 or exponent < 0) else None
    )
    if exponent < 0:
        assert inverse_root is not None
        # x^-¼ = x^¼ x^-½
        parts.append(whole_power(graph, inverse_root, (quarters + (quarters & 1)) // 2))
    else:
        if quarters & 2:
            parts.append(
                graph.node("sqrt", base)
                if inverse_root is None
                else graph.node("mul", base, inverse_root)
            )
        parts.append(whole_power(graph, base, quarters // 4))
    result = graph.one
    for part in parts:
        result = graph.times(result, part)
    return result
