"""Bounds along the path, sorted by where they act.

* A coordinate alone bounds all control points of the path, a control alone all its values: plain
  bounds on unknowns.
* An expression of q, t and parameters is held at all control points.
* An expression with velocities or controls is held at the quadrature nodes, where velocities have
  the rule's order and controls their values. A velocity alone also bounds the velocities at the two
  ends.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.nlp.expressions import column, limits, triples
from varint.scene.system import System


class PathBounds(NamedTuple):
    """Bounds along the path.

    Attributes
    ----------
    q, v, u : ndarray (2, n), (2, n), (2, k)
        Lower and upper bounds of coordinates, of velocities at the ends, of controls.
    at_points, at_nodes, at_steps : SX (a,), (b,), (s,)
        Expressions of (q, t, c), held at control points, of (q, v, u, rates, t, c), held at
        quadrature nodes, and of (rates, c), held once a step.
    points_low, points_high, nodes_low, nodes_high, steps_low, steps_high : ndarray
        Their bounds.
    points_names, nodes_names : tuple of str
        What reports call them.
    """

    q: np.ndarray
    v: np.ndarray
    u: np.ndarray
    at_points: ca.SX
    points_low: np.ndarray
    points_high: np.ndarray
    at_nodes: ca.SX
    nodes_low: np.ndarray
    nodes_high: np.ndarray
    at_steps: ca.SX
    steps_low: np.ndarray
    steps_high: np.ndarray
    points_names: tuple[str, ...]
    nodes_names: tuple[str, ...]


class Integrals(NamedTuple):
    """Bounds on integrals over a phase.

    Attributes
    ----------
    rows : SX (i,)
        The integrands.
    low, high : ndarray (i,)
    """

    rows: ca.SX
    low: np.ndarray
    high: np.ndarray

    @property
    def names(self) -> tuple[str, ...]:
        """What they are called in reports."""
        return tuple(f"integral of {_name(x)}" for x in ca.vertsplit(self.rows))


def path_bounds(system: System, bounds: Any, rates: ca.SX | None = None) -> PathBounds:
    """Bounds as the user wrote them, a list of (lower, expression, upper), sorted by where they
    act; `rates`: symbols of the controls' rates of change.
    """
    s, rates = system, ca.SX(0, 1) if rates is None else rates
    simple = {
        name: np.array([[-np.inf], [np.inf]]) * np.ones(x.numel())
        for name, x in _symbols(s).items()
    }
    place = {
        x.element_hash(): (name, i)
        for name, xs in _symbols(s).items()
        for i, x in enumerate(ca.vertsplit(xs))
    }
    rows: dict[str, list] = {"points": [], "nodes": [], "steps": []}
    allowed = ca.vertcat(s.q, s.v, s.control, rates, s.t, s.c)
    for lower, expression, upper in triples("bounds", bounds):
        found = column(
            "an expression in bounds",
            expression,
            allowed,
            "q, v, the controls, t and the parameters",
        )
        low, high = limits(str(found), lower, upper, found.numel())
        for x, a, b in zip(ca.vertsplit(found), low, high, strict=True):
            if np.isinf(a) and np.isinf(b):
                continue
            if not ca.depends_on(x, ca.vertcat(s.q, s.v, s.control, rates)):
                raise InputError(
                    f"the bound on {x} does not depend on the path; bound parameters with free(…)"
                )
            name, i = place.get(x.element_hash(), (None, 0)) if x.is_symbolic() else (None, 0)
            if name is not None:
                simple[name][:, i] = max(simple[name][0, i], a), min(simple[name][1, i], b)
                if simple[name][0, i] > simple[name][1, i]:
                    raise InputError(
                        f"the bounds of {x} contradict each other: {simple[name][:, i].tolist()}"
                    )
            if name in (None, "v"):
                rows[_place(s, rates, x)].append((x, a, b))
    (points, points_low, points_high), (nodes, nodes_low, nodes_high), steps = (
        _stack(rows[x]) for x in ("points", "nodes", "steps")
    )
    return PathBounds(
        simple["q"],
        simple["v"],
        simple["u"],
        points,
        points_low,
        points_high,
        nodes,
        nodes_low,
        nodes_high,
        *steps,
        points_names=tuple(map(_name, ca.vertsplit(points))),
        nodes_names=tuple(map(_name, ca.vertsplit(nodes))),
    )


LONG = 80  # letters of an expression: longer ones are cut short in reports


def _name(x: ca.SX) -> str:
    found = str(x)
    return found if len(found) <= LONG else f"{found[: LONG - 8]}… #{x.element_hash() % 1000:03d}"


def _place(system: System, rates: ca.SX, x: ca.SX) -> str:
    """Where an expression is held."""
    s = system
    if not ca.depends_on(x, ca.vertcat(s.v, s.control, rates)):
        return "points"
    return "nodes" if ca.depends_on(x, ca.vertcat(s.q, s.v, s.control, s.t)) else "steps"


def integrals_of(given: Any, path: ca.SX, c: ca.SX) -> Integrals:
    """Bounds on integrals as the user wrote them, a list of (lower, integrand, upper)."""
    rows, lows, highs = [ca.SX(0, 1)], [np.zeros(0)], [np.zeros(0)]
    words = "q, v, the controls, t and the parameters"
    for lower, expression, upper in triples("integral", given):
        found = column("an integrand in integral", expression, ca.vertcat(path, c), words)
        low, high = limits(f"the integral of {found}", lower, upper, found.numel())
        rows.append(found)
        lows.append(low)
        highs.append(high)
    return Integrals(ca.vertcat(*rows), np.concatenate(lows), np.concatenate(highs))


def _symbols(system: System) -> dict[str, ca.SX]:
    return {"q": system.q, "v": system.v, "u": system.control}


def _stack(rows: list) -> tuple[ca.SX, np.ndarray, np.ndarray]:
    expressions, low, high = ([row[i] for row in rows] for i in range(3))
    return (
        ca.vertcat(ca.SX(0, 1), *expressions),
        np.array(low, dtype=float),
        np.array(high, dtype=float),
    )
