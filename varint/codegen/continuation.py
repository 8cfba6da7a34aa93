"""Start values of Newton's method: the unknowns of the last steps continued over the next one."""

from __future__ import annotations

import numpy as np

from varint.rules.rule import Rule

# steps that start values are continued from, by degree; else 1: more amplifies round-off
HISTORY = {1: 3, 2: 2, 3: 2}
# and by their accelerations
FORCED_HISTORY = {1: 3, 2: 3, 3: 2}
VANISHES = 1e-12  # of numbers of the size of one: what their own rounding leaves


def continuation_tables(rule: Rule, history: int) -> dict[str, np.ndarray]:
    """Coefficients that continue the unknowns of the last 1, 2 … `history` steps over the next one.

    The polynomial through all control points of those steps, in mean velocities (Q_j − q0)/h; the
    one through all multipliers. Start values only: they need no last digits.
    """
    points, degree = np.array(rule.points), rule.degree
    velocities, multipliers, rows = [], [], []
    for known in range(1, history + 1):
        at = np.array([points[j] - s for s in range(1, known + 1) for j in range(degree)])
        path = _lagrange(np.append(at, 0.0), points[1:])
        table = np.zeros((degree, known, degree))
        for s in range(known):
            for j in range(degree):
                weight = path[:, s * degree + j]
                if j:
                    table[:, s, j - 1] += weight
                # where the step begins: behind by the steps in between
                table[:, : s + 1, -1] -= weight[:, None]
        velocities.append(table.ravel())
        multipliers.append(_lagrange(at, points[:-1]).ravel())
        rows.append(_lagrange(-1.0 - np.arange(known), np.zeros(1)).ravel())
    return {
        "AHEAD_VELOCITIES": np.concatenate(velocities),
        "AHEAD_MULTIPLIERS": np.concatenate(multipliers),
        "AHEAD_ROWS": np.concatenate(rows),
    }


def force_table(rule: Rule, history: int) -> np.ndarray:
    """Coefficients that continue the steps of a scene of constant mass by its accelerations.

    With these, a(c_i) at the nodes of a step, its mean velocities and what its velocity gains are
    z = points v0 + h Â a and v1 − v0 = h b a, exactly: of 1, 2 … `history` steps they tell the
    polynomial a(t), whose values at the nodes of the next step tell its z. The stages lie off the
    motion by h⁴ or so, which a polynomial through them would carry along. For each j and each
    number of steps: of the last step z_1 … z_d and v0, of that before it the same, …; v0 of the
    next.
    """
    degree, weights = rule.degree, np.array(rule.weights)
    nodes, points = np.array(rule.nodes), np.array(rule.points[1:])
    rows = weights * rule.slopes.T  # of the discrete equations, the one at the start first
    free = rows[:degree] @ rule.slopes[:, 1:]
    pushed = -np.linalg.solve(free, (weights * rule.basis.T)[:degree])
    gains = np.vstack([pushed, weights])
    offsets = _stage_offsets(rule, pushed)
    tables = []
    for known in range(1, history + 1):
        times = np.array([nodes - s for s in range(1, known + 1)])
        most = min(len(np.unique(times.round(12))), known * (degree + 1))
        off = (
            max(known - 2, 0) if offsets.any() else 0
        )  # so many coefficients describe how they change
        behind = np.vstack([gains @ _accelerations(at, most - off, offsets, off) for at in times])
        next_ones = pushed @ _accelerations(nodes, most - off, offsets, off)
        ahead = next_ones @ np.linalg.pinv(behind)
        table = np.zeros((degree, known * (degree + 1) + 1))
        table[:, -1] = points
        for s in range(known):
            first, now = s * (degree + 1), s * (degree + 1) + degree
            after = first - 1 if s else table.shape[1] - 1  # v0 of the step that follows
            stages, gain = ahead[:, first:now], ahead[:, now]
            table[:, first:now] += stages
            table[:, now] -= stages @ points + gain
            table[:, after] += gain
        tables.append(table.ravel())
    return np.concatenate(tables)


def _accelerations(at: np.ndarray, smooth: int, offsets: np.ndarray, off: int) -> np.ndarray:
    """Values at the nodes of a step of 1, t, …, and of the offsets times 1, t, …"""
    powers = np.vander(at, max(smooth, off), increasing=True)
    return np.hstack([powers[:, :smooth], offsets[:, None] * powers[:, :off]])


def _stage_offsets(rule: Rule, pushed: np.ndarray) -> np.ndarray:
    """How far the path at each node lies off the motion, up to a factor; none where it is as far at
    all nodes.
    """
    nodes, reached = np.array(rule.nodes), rule.basis[:, 1:] @ pushed
    for m in range(2 * len(nodes)):
        missing = nodes ** (m + 2) / ((m + 1) * (m + 2)) - reached @ nodes**m
        if abs(missing).max() > VANISHES:
            return missing if np.ptp(missing) > VANISHES else 0 * missing
    return 0 * nodes


def _lagrange(at: np.ndarray, x: np.ndarray) -> np.ndarray:
    """ℓ_k(x_j) of the points `at`, (j, k)."""
    result = np.ones((len(x), len(at)))
    for k, a in enumerate(at):
        for i, b in enumerate(at):
            if i != k:
                result[:, k] *= (x - b) / (a - b)
    return result
