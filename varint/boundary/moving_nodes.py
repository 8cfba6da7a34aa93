"""The equations of a path whose nodes move along with it.

Beside the control points the times of the nodes are unknown, and every step is asked to be as long
as its neighbour, in the length

    ∫ √(|dq/R_q|² + |dp/R_p|² + (dt/R_t)²)

of the path among coordinates, momenta and time, by its control points (equidistribution; Ascher,
Mattheij & Russell, Numerical Solution of Boundary Value Problems, §9.1). A path that passes a
centre of attraction closely stays resolved there while Newton's method bends it, and a first path
of the right shape that comes there too early or too late is near the true one: on fixed nodes it is
far away.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from varint.boundary.iterate import Iterate, iterate_through, point_times
from varint.boundary.newton import coordinate_ranges
from varint.boundary.stationary import (
    BoundaryValueProblem,
    interval_rows,
    momenta_and_action,
    number_unknowns,
)
from varint.discrete.lagrangian import interval
from varint.nlp.assembly import Element, assemble_equations
from varint.rules.polynomials import lagrange_values
from varint.rules.rule import Rule
from varint.scene.memory import per_system
from varint.scene.system import System

SLOWNESS = 2.0  # R_t in durations: no step is longer than so much time
LEAST_SPAN = 1e-3  # of the largest momentum, in units of energy: what moves less is not looked at


@dataclass(frozen=True, eq=False)
class MovingPath:
    """An iterate with the sizes (N,) of its steps, and the scales (R_q, R_p, R_t) of their length,
    (2n + 1,).
    """

    iterate: Iterate
    sizes: np.ndarray
    scales: np.ndarray

    def moved(self, change: np.ndarray) -> MovingPath:
        """The path after a change of all unknowns; the last one is the duration."""
        of_times = slice(-len(self.sizes) - 2, -1)
        own = np.concatenate([change[: of_times.start], change[-1:]])
        sizes = self.sizes + np.diff(change[of_times])
        return replace(self, iterate=self.iterate.moved(own), sizes=sizes)

    @property
    def runs_forwards(self) -> bool:
        """Whether all steps, and so the duration, are positive."""
        return bool((self.sizes > 0).all() and self.iterate.duration > 0)

    @property
    def weights(self) -> np.ndarray:
        """What a change of each unknown counts in a mean square: one over its scale."""
        steps, d, n = self.iterate.increments.shape
        count = steps * d + 1
        point = 1 / self.scales[:n] / np.sqrt(count)
        times = np.full(steps + 1, 1 / np.sqrt(steps + 1) / self.iterate.duration)
        return np.concatenate(
            [np.tile(point, count), np.zeros(2 * n), times, [1 / self.iterate.duration]]
        )


def even_nodes(problem: BoundaryValueProblem, path: MovingPath) -> BoundaryValueProblem:
    """The problem on the nodes of a moving path."""
    grid = np.append(0.0, np.cumsum(path.sizes))
    u = np.broadcast_to(problem.u[:1], (len(path.sizes), problem.u.shape[1]))
    return replace(problem, grid=grid * (len(path.sizes) / grid[-1]), u=u)


def scaled(problem: BoundaryValueProblem, iterate: Iterate, sizes: np.ndarray) -> MovingPath:
    """A moving path in the scales of its own coordinates and momenta."""
    scales = np.zeros(2 * iterate.starts.shape[1] + 1)
    path = MovingPath(iterate, sizes, scales)
    p, _ = momenta_and_action(even_nodes(problem, path), iterate)
    ranges, span = coordinate_ranges(iterate.points), np.ptp(p, axis=0)
    least = LEAST_SPAN * (np.abs(p).max(axis=0) * ranges).max() / ranges
    scales[:] = *ranges, *np.maximum(span, least + np.finfo(float).tiny), SLOWNESS * sizes.sum()
    return path


def lengths(problem: BoundaryValueProblem, path: MovingPath, scales: np.ndarray) -> np.ndarray:
    """Length of every step in the given scales, (N,)."""
    p, _ = momenta_and_action(even_nodes(problem, path), path.iterate)
    steps, d, n = path.iterate.increments.shape
    inner = np.diff(path.iterate.increments, axis=1, prepend=0.0) * np.sqrt(d) / scales[:n]
    moved = np.hstack([np.diff(p, axis=0), path.sizes[:, None]]) / scales[n:]
    return np.linalg.norm(np.hstack([inner.reshape(steps, -1), moved]), axis=1)


def remeshed(problem: BoundaryValueProblem, path: MovingPath, scales: np.ndarray) -> MovingPath:
    """The same path on nodes that are even in other scales."""
    steps, t = len(path.sizes), np.append(0.0, np.cumsum(path.sizes))
    along = np.append(0.0, np.cumsum(lengths(problem, path, scales)))
    new = np.interp(np.linspace(0, along[-1], steps + 1), along, t)
    iterate = through_times(problem.rule, path, new, problem.rule)
    return MovingPath(iterate, np.diff(new), scales)


def through_times(rule: Rule, path: MovingPath, t: np.ndarray, wanted: Rule) -> Iterate:
    """The path on nodes at the times `t`, counted from its start, as an iterate of the wanted
    rule.
    """
    own, old = path.iterate, np.append(0.0, np.cumsum(path.sizes))
    at = _control_times(t, point_times(wanted))
    k = np.clip(np.searchsorted(old, at, side="right") - 1, 0, len(path.sizes) - 1)
    table = lagrange_values(point_times(rule), (at - old[k]) / path.sizes[k])[:, 1:]
    points = own.starts[k] + np.einsum("jd,jdn->jn", table, own.increments[k])
    points[-1] = own.end
    moved = iterate_through(points, len(point_times(wanted)) - 1, 0, own.duration)
    return replace(moved, momenta=own.momenta)


def moving_path(
    problem: BoundaryValueProblem, nodes: np.ndarray, duration: float, steps: int
) -> MovingPath:
    """The straight lines between equally spaced nodes, on steps of about equal length."""
    fine, tau = len(nodes) - 1, point_times(problem.rule)
    ranges = coordinate_ranges(nodes)
    slope = np.gradient(nodes / ranges, axis=0) if fine > 1 else np.zeros(nodes.shape)
    turn = np.diff(slope, axis=0) / max(float(np.abs(slope).max()), np.finfo(float).tiny)
    ahead = np.hstack(
        [np.diff(nodes / ranges, axis=0), turn, np.full((fine, 1), 1 / (SLOWNESS * fine))]
    )
    along = np.append(0.0, np.cumsum(np.linalg.norm(ahead, axis=1)))
    shares = np.linspace(0, 1, fine + 1)
    at = np.interp(np.linspace(0, along[-1], steps + 1), along, shares)
    points = np.stack([np.interp(_control_times(at, tau), shares, x) for x in nodes.T], axis=1)
    if problem.ends is not None:
        points[0], points[-1] = problem.ends
    iterate = iterate_through(points, len(tau) - 1, 0, duration)
    return scaled(problem, iterate, duration * np.diff(at))


def _control_times(t: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Times of the control points of all steps."""
    return np.append((t[:-1, None] + np.diff(t)[:, None] * tau[:-1]).ravel(), t[-1])


def constants(problem: BoundaryValueProblem, path: MovingPath) -> np.ndarray:
    """The data of the rows, in the order of `_places`."""
    iterate = path.iterate
    assert problem.ends is not None
    left = iterate.starts[0] - problem.ends[0], iterate.end - problem.ends[1]
    parts = [
        iterate.starts,
        iterate.increments,
        np.broadcast_to(problem.u[:1], (len(path.sizes), problem.u.shape[1])),
        np.append(0.0, np.cumsum(path.sizes)[:-1]),
        path.sizes,
        np.concatenate([problem.c, [problem.t0], path.scales]),
        *left,
        iterate.momenta,
        np.array([iterate.duration - path.sizes.sum()]),
    ]
    return np.concatenate([x.ravel() for x in parts])


@per_system
def moving_equations(system: System, rule: Rule, steps: int) -> tuple[ca.Function, ca.Function]:
    """(changes, constants) → rows, and with their derivatives.

    Changes of the control points, of the momenta at both ends, of the nodes' times
    and of the duration. The last row is the change of the duration: the duration is kept.
    """
    one = interval(system, rule)
    n, d = one.dq.shape
    points = steps * d + 1
    place, size = _places(n, d, one.u.numel(), one.c.numel(), steps)
    momenta = points * n + np.arange(2 * n)
    times = points * n + 2 * n + np.arange(steps + 1)
    duration = times[-1:] + 1
    first, last = np.arange(n), (points - 1) * n + np.arange(n)

    window = np.arange(steps)[:, None] * d * n + np.arange((d + 1) * n)
    both = np.stack([times[:-1], times[1:]], axis=1)
    even = both.copy()
    even[0, 0] = even[-1, 1] = -1  # the ends' times are given
    change, data, values = _moving_interval(system, rule)
    own = "starts", "increments", "u", "begin", "size"
    shared = np.broadcast_to(place["shared"], (steps, len(place["shared"])))
    piece = Element(
        change,
        data,
        ca.SX(0),
        values,
        np.hstack([window, both]),
        np.hstack([*(place[name] for name in own), shared]),
        np.hstack([window, even]),
    )
    changes, given, conditions = _moving_ends(n)
    border = Element(
        changes,
        given,
        ca.SX(0),
        conditions,
        np.concatenate([first, last, momenta, times[[0, -1]], duration])[None],
        np.concatenate([place["left"], place["momenta"], place["clock"]])[None],
        np.concatenate([first, last, momenta, times[[0, -1]], duration])[None],
    )
    return assemble_equations([piece, border], int(duration[0]) + 1, size)


def _places(
    n: int, d: int, controls: int, parameters: int, steps: int
) -> tuple[dict[str, np.ndarray], int]:
    """Where the data of each interval sit among the constants, and how many those are."""
    return number_unknowns(
        starts=(steps, n),
        increments=(steps, d * n),
        u=(steps, controls),
        begin=(steps, 1),
        size=(steps, 1),
        shared=(parameters + 1 + 2 * n + 1,),
        left=(2 * n,),
        momenta=(2 * n,),
        clock=(1,),
    )


def _moving_interval(system: System, rule: Rule) -> tuple[ca.SX, ca.SX, ca.SX]:
    """(changes, data, rows) of one interval; the last two rows are minus and plus the logarithm of
    its length, which is subtracted from that of the next one.
    """
    one = interval(system, rule)
    n, d = one.dq.shape
    change, times = ca.SX.sym("change", n, d + 1), ca.SX.sym("times", 2)
    begin, size, t0 = (ca.SX.sym(name) for name in ("begin", "size", "t0"))
    scales = ca.SX.sym("scales", 2 * n + 1)
    data = ca.vertcat(one.q0, ca.vec(one.dq), ca.vec(one.u), begin, size, one.c, t0, scales)
    ahead = ca.vec(one.dq) + ca.vec(change[:, 1:] - ca.repmat(change[:, 0], 1, d))
    h = size + times[1] - times[0]
    rows, _ = interval_rows(system, rule)(
        one.q0 + change[:, 0],
        ahead,
        ca.vec(one.lam),
        ca.vec(one.u),
        one.c,
        t0 + begin + times[0],
        h,
    )
    gained = ca.sum2(ca.reshape(rows, n, d + 1))
    # from control point to control point: a step out and back has no chord, and would grow
    inner = ca.vec(ca.diff(ca.horzcat(ca.SX.zeros(n), ca.reshape(ahead, n, d)), 1, 1))
    inner /= ca.repmat(scales[:n], d, 1) / np.sqrt(d)
    moved = ca.vertcat(gained, h) / scales[n:]
    length = ca.log(ca.sumsqr(inner) + ca.sumsqr(moved)) / 2
    return ca.vertcat(ca.vec(change), times), data, ca.vertcat(rows, -length, length)


def _moving_ends(n: int) -> tuple[ca.SX, ca.SX, ca.SX]:
    """(changes, data, rows) of both ends: momenta, places, times, duration."""
    changes = [ca.SX.sym("change", size) for size in (n, n, n, n, 1, 1, 1)]
    start, end, p_start, p_end, t_start, t_end, duration = changes
    left, p0, p1 = (ca.SX.sym(name, size) for name, size in (("left", 2 * n), ("p0", n), ("p1", n)))
    clock = ca.SX.sym("clock")
    rows = [p0 + p_start, -(p1 + p_end), left[:n] + start, left[n:] + end]
    rows += [t_start, t_end - duration - clock, duration]
    return ca.vertcat(*changes), ca.vertcat(left, p0, p1, clock), ca.vertcat(*rows)
