"""Constants of the stage-parallel Gauss method, computed with 50 digits and rounded without harm.

With unknowns ``L_j = h b_j F_j`` the method has the coefficients ``m_ij = a_ij / b_j`` and, in
second-order form, ``M_ij = (A A)_ij / b_j``. It is symplectic and symmetric when ``m_ij + m_ji =
1``, ``m_ij = m_{s+1-j, s+1-i}`` and ``M_ij − M_ji = c_i − c_j``. Rounded to multiples of 2⁻⁵²
(2⁻⁵³), these hold exactly in floating point, so that rounding the coefficients causes no drift
(after Antoñana, Makazaga & Murua, Numer. Algorithms 76, 2017).
"""

from __future__ import annotations

from decimal import Decimal, localcontext
from functools import lru_cache

import numpy as np

from varint.codegen.kept import code_of, keep_content, kept_content, key_of
from varint.rules import polynomials
from varint.rules.polynomials import (
    PRECISE,
    derivative,
    gauss_nodes,
    lagrange_polynomials,
    value,
)

Matrix = list[list[Decimal]]
# of the start polynomial fitted to two steps, over s − 1; more only amplifies what is not smooth
EXTRA_DEGREE = 4
# of the one for stages that carry larger errors than round-off, which a high degree amplifies
LOW_DEGREE = 5
DIGITS = 10  # behind the point of numbers that steer an iteration


@lru_cache(maxsize=64)
def gauss_tableau(stages: int) -> dict[str, np.ndarray]:
    """The constants by their names in gauss.h: vectors (1, s), matrices (s, s). They are kept on
    the disk: to read them takes a tenth of the time.
    """
    key = key_of("tableau", str(stages), code=code_of(__file__, polynomials.__file__))
    names, _, numbers = kept_content(key).partition(b"\n")
    if names:
        tables, at = {}, 0
        for name, rows in (word.split(":") for word in names.decode().split()):
            shape = int(rows), stages
            tables[name] = np.frombuffer(numbers, float, shape[0] * stages, at).reshape(shape)
            at += tables[name].nbytes
        return tables
    tables = _computed(stages)
    heads = " ".join(f"{name}:{len(table)}" for name, table in tables.items())
    keep_content(key, b"\n".join((heads.encode(), b"".join(x.tobytes() for x in tables.values()))))
    return tables


def _computed(stages: int) -> dict[str, np.ndarray]:
    with localcontext(PRECISE):
        c = gauss_nodes(stages)
        integrals = [derivative(p, -1) for p in lagrange_polynomials(c)]
        *a, b = [[value(p, x) for p in integrals] for x in [*c, Decimal(1)]]
        m1 = _over(a, b)
        m2 = _over(_times(a, a), b)
        both = [x - 1 for x in c] + c
        degree = min(stages - 1 + EXTRA_DEGREE, 2 * stages - 1)
        starts = {}
        for name, one, two in (("START", stages - 1, degree), ("LOW", LOW_DEGREE - 1, LOW_DEGREE)):
            table = _weighted(_continuation(both, c, min(two, degree)), b)
            starts[name], starts[f"{name}_OLDER"] = (
                [row[stages:] for row in table],
                [row[:stages] for row in table],
            )
            starts[f"{name}_ONE"] = _weighted(_continuation(c, c, min(one, stages - 1)), b)
        nodes = _rounded_nodes(c)
        tables = {
            "STAGE_C": [nodes],
            "STAGE_B": [[float(x) for x in b]],
            "STAGE_BETA": [[1.0 - x for x in nodes]],
            "STAGE_M1": _rounded_first(m1),
            "STAGE_M2": _rounded_second(m2, nodes),
        }
        for order, m in (("M1", m1), ("M2", m2)):
            for name, start in starts.items():
                tables[f"{name}_{order}"] = [[float(x) for x in row] for row in _times(m, start)]
        for name, start in starts.items():
            tables[f"{name}_M0"] = [[float(x) for x in row] for row in start]
        # A⁻¹: the slopes at the nodes of the polynomial through these values there and zero at 0
        slopes = [derivative(p, 1) for p in lagrange_polynomials([Decimal(0), *c])[1:]]
        tables["STAGE_INVERSE"] = [[float(value(p, x)) for p in slopes] for x in c]
    arrays = {name: np.array(rows) for name, rows in tables.items()}
    return arrays | modes(np.array(a, float), arrays["STAGE_B"][0])


def modes(a: np.ndarray, b: np.ndarray) -> dict[str, np.ndarray]:
    """What takes unknowns to the modes of A, its eigenvectors T, and back: rows of the real, then
    of the imaginary parts of T⁻¹ / b_j; b_i 2 Re(T y); and the eigenvalues, one of each pair. An
    odd number of stages has one that is no pair, and no such tables.

    They steer an iteration and need not be exact: rounded, they are alike on all machines.
    """
    s = len(b)
    to, back, values = np.zeros((s, s)), np.zeros((s, s)), np.zeros((2, s))
    if s % 2 == 0:
        eigenvalues, vectors = np.linalg.eig(a)
        order = np.argsort(eigenvalues.imag)[s // 2 :]
        eigenvalues, vectors = eigenvalues[order], vectors[:, order] / vectors[-1, order]
        inverse = np.linalg.inv(np.hstack((vectors, vectors.conj())))[: s // 2]
        to[:] = np.vstack((inverse.real, inverse.imag)) / b
        back[:] = np.hstack((2 * vectors.real, -2 * vectors.imag)) * b[:, None]
        values[:, : s // 2] = eigenvalues.real, eigenvalues.imag
    names = {"STAGE_MODES": to, "STAGE_OF_MODES": back}
    names |= {"MODE_RE": values[:1], "MODE_IM": values[1:]}
    return {name: np.round(table, DIGITS) for name, table in names.items()}


@lru_cache(maxsize=64)
def tableau_arrays(stages: int, lanes: int, diagonals: bool) -> dict[str, np.ndarray]:
    """The constants over vectors of so many lanes, one number after the other.

    Lanes beyond the stages repeat the last row, with weight 0. By diagonals a matrix becomes, for
    each block of lanes × lanes and each r < lanes, the entries (i, i XOR r); otherwise its columns.
    """
    padded = -(-stages // lanes) * lanes
    arrays = {}
    for name, table in gauss_tableau(stages).items():
        if table.shape[0] == stages:
            full = np.zeros((padded, padded))
            full[:stages, :stages] = table
            full[stages:, :stages] = table[-1]
            table = _diagonals(full, lanes) if diagonals else full.T[:stages]
        else:
            last = 0.0 if name == "STAGE_B" else table[0, -1]
            table = np.append(table, np.full((1, padded - stages), last), axis=1)
        arrays[name] = table.ravel()
    return arrays


@lru_cache(maxsize=64)
def tableau_source(stages: int, lanes: int, diagonals: bool) -> str:
    """`tableau_arrays` in C."""
    lines = [
        f"#define STAGES {stages}",
        f"#define PADDED {-(-stages // lanes) * lanes}",
        f"#define DIAGONALS {int(diagonals)}",
    ]
    for name, array in tableau_arrays(stages, lanes, diagonals).items():
        numbers = ", ".join(float(x).hex() for x in array)
        lines.append(
            f"static const double {name}[] __attribute__((aligned(64), unused)) = {{{numbers}}};"
        )
    return "\n".join(lines) + "\n"


def _diagonals(matrix: np.ndarray, lanes: int) -> np.ndarray:
    """Entries (i, i XOR r) of each block of columns, r after r."""
    i = np.arange(len(matrix))
    rows = [
        matrix[i, block + (i % lanes ^ r)]
        for block in range(0, len(matrix), lanes)
        for r in range(lanes)
    ]
    return np.array(rows)


def _times(x: Matrix, y: Matrix) -> Matrix:
    return (np.array(x, dtype=object) @ np.array(y, dtype=object)).tolist()


def _over(m: Matrix, b: list[Decimal]) -> Matrix:
    return [[x / y for x, y in zip(row, b, strict=True)] for row in m]


def _weighted(m: Matrix, b: list[Decimal]) -> Matrix:
    """The same map between values times weights: b_i m_ij / b_j, the columns running through the
    stages repeatedly.
    """
    return [
        [b_i * x / b[j % len(b)] for j, x in enumerate(row)] for b_i, row in zip(b, m, strict=True)
    ]


def _continuation(known: list[Decimal], c: list[Decimal], degree: int) -> Matrix:
    """Values at 1 + c of the polynomial of this degree that fits values at the known points best
    (least squares).
    """
    low = min(known)
    basis = [_legendre_values((2 * x - 1 - low) / (1 - low), degree) for x in known]
    ahead = [_legendre_values((2 * (1 + x) - 1 - low) / (1 - low), degree) for x in c]
    transposed = [list(column) for column in zip(*basis, strict=True)]
    return _times(ahead, _solved(_times(transposed, basis), transposed))


def _legendre_values(x: Decimal, degree: int) -> list[Decimal]:
    values = [Decimal(1), x]
    for k in range(1, degree):
        values.append(((2 * k + 1) * x * values[k] - k * values[k - 1]) / (k + 1))
    return values[: degree + 1]


def _solved(matrix: Matrix, right: Matrix) -> Matrix:
    """matrix⁻¹ right by Gauss–Jordan elimination; the matrix is positive definite."""
    n = len(matrix)
    rows = [np.array([*a, *b], dtype=object) for a, b in zip(matrix, right, strict=True)]
    for k in range(n):
        rows[k] = rows[k] / rows[k][k]
        for i in range(n):
            if i != k:
                factor = rows[i][k]
                rows[i] = rows[i] - factor * rows[k]
    return [row[n:].tolist() for row in rows]


def _on_grid(x: Decimal, bits: int) -> float:
    return float(int((x * 2**bits).to_integral_value())) / 2.0**bits


def _rounded_nodes(c: list[Decimal]) -> list[float]:
    """c on the grid of 2⁻⁵³ with c_{s+1−i} = 1 − c_i."""
    s = len(c)
    nodes = [0.5] * s
    for i in range(s // 2):
        nodes[i] = _on_grid(c[i], 53)
        nodes[s - 1 - i] = 1.0 - nodes[i]
    return nodes


def _rounded_first(m: Matrix) -> list[list[float]]:
    s = len(m)
    result = [[0.5] * s for _ in range(s)]
    for i in range(s):
        for j in range(i):
            if i + j <= s - 1:  # its mirror images (j, i), (s−1−i, s−1−j), (s−1−j, s−1−i) follow
                x = _on_grid(m[i][j], 52)
                result[i][j] = result[s - 1 - j][s - 1 - i] = x
                result[j][i] = result[s - 1 - i][s - 1 - j] = 1.0 - x
    return result


def _rounded_second(m: Matrix, c: list[float]) -> list[list[float]]:
    s = len(m)
    result = [[0.0] * s for _ in range(s)]
    for i in range(s):
        for j in range(i + 1):
            if i + j <= s - 1:
                x = _on_grid(m[i][j], 53)
                result[i][j] = result[s - 1 - j][s - 1 - i] = x
                result[j][i] = result[s - 1 - i][s - 1 - j] = x - (c[i] - c[j])
    return result
