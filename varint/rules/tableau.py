"""Rules as tableaux in LaTeX: Butcher's, in pairs where p has its own; kicks and drifts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from varint.rules.closed_form import closed_form

WIDEST = 4  # stages whose matrix is shown; of more, nodes and weights
SAME = 1e-14


def butcher(name: str, nodes: Sequence[float], matrix: np.ndarray, weights: Sequence[float]) -> str:
    """c | A over b of the coordinates, and Â of the momenta where it differs, which makes the pair
    symplectic: b_i â_ij + b_j a_ji = b_i b_j.
    """
    b = np.array(weights)
    other = b[None, :] * (1 - matrix.T / b[:, None])
    if len(nodes) > WIDEST:
        return columns(name, {"c": nodes, "b": weights})
    pair = [matrix] if np.abs(other - matrix).max() < SAME else [matrix, other]
    tableaux = [_array(nodes, a, weights) for a in pair]
    return _shown(name, r" \qquad ".join(tableaux))


def columns(name: str, named: Mapping[str, Sequence[float]]) -> str:
    """Named columns of numbers, of different lengths."""
    count = max(len(x) for x in named.values())
    rows = [
        " & ".join(closed_form(x[i]) if i < len(x) else "" for x in named.values())
        for i in range(count)
    ]
    head = " & ".join(named)
    body = r" \\ ".join(rows)
    return _shown(
        name, rf"\begin{{array}}{{{'c' * len(named)}}} {head} \\ \hline {body} \end{{array}}"
    )


def _array(nodes: Sequence[float], matrix: np.ndarray, weights: Sequence[float]) -> str:
    rows = [
        " & ".join([closed_form(c), *(closed_form(x) for x in row)])
        for c, row in zip(nodes, matrix.tolist(), strict=True)
    ]
    last = " & ".join(["", *(closed_form(x) for x in weights)])
    body = r" \\ ".join(rows)
    return rf"\begin{{array}}{{c|{'c' * len(weights)}}} {body} \\ \hline {last} \end{{array}}"


def _shown(name: str, text: str) -> str:
    return rf"$\displaystyle \texttt{{{name.replace('_', chr(92) + '_')}}} \qquad {text}$"
