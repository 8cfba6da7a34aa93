"""What an animation draws of a scene: points, rods between them and the traces they leave, as
data.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import casadi as ca

from varint.errors import InputError, parsed_or_refused


@dataclass(frozen=True, eq=False)
class Sketch:
    """Points in the plane or in space as expressions of q, t and the parameters; rods and traces by
    their names.

    Parameters
    ----------
    points : mapping of str to SX (2,) or (3,)
        Where each point is; numbers for fixed ones.
    rods : sequence of (str, str)
        Pairs of points joined by a line.
    traces : sequence of str
        Points whose recent path is drawn.
    marks : sequence of str, optional
        Points drawn as dots; default: all.

    Raises
    ------
    InputError
        If a point has not two or three coordinates, or a rod or trace names a point that does not
        exist.

    Examples
    --------
    >>> import casadi as ca
    >>> import varint as vi
    >>> q, v = vi.coordinates("theta")
    >>> points = {"pin": [0, 0], "bob": ca.vertcat(ca.sin(q), -ca.cos(q))}
    >>> vi.Sketch(points, rods=[("pin", "bob")], traces=["bob"])
    Sketch(pin, bob; 1 rods, 2 dimensions)
    """

    points: Mapping[str, Any]
    rods: Sequence[tuple[str, str]] = ()
    traces: Sequence[str] = ()
    marks: Any = None

    def __post_init__(self) -> None:
        if not isinstance(self.points, Mapping) or not self.points:
            raise InputError('a sketch needs at least one point, such as {"bob": ca.vertcat(x, y)}')
        points = {
            name: ca.vec(ca.SX(ca.vertcat(*_entries(name, where))))
            for name, where in self.points.items()
        }
        sizes = {name: point.numel() for name, point in points.items()}
        if set(sizes.values()) not in ({2}, {3}):
            raise InputError(f"points must all have 2 coordinates or all have 3, got {sizes}")
        rods, traces, marks = parsed_or_refused(
            lambda: (
                tuple(map(tuple, self.rods)),
                tuple(self.traces),
                tuple(points) if self.marks is None else tuple(self.marks),
            ),
            lambda: (
                f"rods are pairs of points, traces and marks are points, all by their names; got "
                f"rods={self.rods!r}, traces={self.traces!r}, marks={self.marks!r}"
            ),
        )
        named = {name for rod in rods for name in rod} | set(traces) | set(marks)
        if named - set(points):
            raise InputError(
                f"rods, traces and marks name unknown points {sorted(named - set(points))}; known: "
                f"{list(points)}"
            )
        for name, value in (
            ("points", MappingProxyType(points)),
            ("rods", rods),
            ("traces", traces),
            ("marks", marks),
        ):
            object.__setattr__(self, name, value)

    @property
    def dimensions(self) -> int:
        """2 or 3."""
        return next(iter(self.points.values())).numel()

    def __repr__(self) -> str:
        return (
            f"Sketch({', '.join(self.points)}; {len(self.rods)} rods, {self.dimensions} dimensions)"
        )


def cartesian(names: Sequence[str], q: ca.SX) -> Sketch | None:
    """The bodies of a scene in Cartesian coordinates, read from names such as x1, y1, z1; None
    for other names.
    """
    places: dict[str, dict[str, ca.SX]] = {}
    for name, symbol in zip(names, ca.vertsplit(q), strict=True):
        match = re.fullmatch(r"([xyz])_?(\w*)", name)
        if match is None:
            return None
        places.setdefault(match[2], {})[match[1]] = symbol
    axes = {tuple(sorted(place)) for place in places.values()}
    if len(axes) != 1 or axes.pop() not in {("x", "y"), ("x", "y", "z")}:
        return None
    points = {
        body or "body": ca.vertcat(*(place[axis] for axis in sorted(place)))
        for body, place in places.items()
    }
    return Sketch(points, traces=tuple(points))


def _entries(name: str, where: Any) -> list:
    return parsed_or_refused(
        lambda: (
            ca.vertsplit(ca.vec(ca.SX(where)))
            if isinstance(where, (ca.SX, ca.DM))
            else [ca.SX(x) for x in where]
        ),
        lambda: f"point {name!r} must be a column of 2 or 3 expressions, got {where!r}",
    )
