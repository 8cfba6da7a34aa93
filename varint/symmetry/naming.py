"""Readable names of generators: translations, rotations, boosts, cyclic coordinates, shifts of
time.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import casadi as ca
import numpy as np

from varint.scene.system import System
from varint.symmetry.search import Pairs

AXES = "xyz"
AXIS_IN_NAME = r"(?P<axis>[xyz])_?(?P<rest>\d*|_\w+)|(?P<body>\w*?)_?(?P<last>[xyz])"
SMALL_BLOCK = 6  # coordinates
# of matrices within particles: the null space of that many unknowns takes seconds
MOST_ENTRIES = 700
ALIKE = 1e-9  # relative: coefficients this close are the same


@dataclass(frozen=True)
class Particles:
    """Coordinates read as positions of particles: `index[particle][axis]` is the coordinate's
    number.
    """

    index: tuple[dict[str, int], ...]

    @property
    def axes(self) -> str:
        return "".join(a for a in AXES if any(a in particle for particle in self.index))


def particles(names: tuple[str, ...]) -> Particles:
    """Particles by the names of their coordinates, as in x1, y1, x2, y2 or sun_x, sun_y; other
    names are left out.
    """
    found: dict[str, dict[str, int]] = {}
    for i, name in enumerate(names):
        match = re.fullmatch(AXIS_IN_NAME, name, re.IGNORECASE)
        if match:
            axis = (match["axis"] or match["last"]).lower()
            found.setdefault((match["rest"] or match["body"] or "").strip("_"), {})[axis] = i
    return Particles(tuple(found.values()))


def groups_of(system: System, largest: int) -> list[Pairs]:
    """Entries of A that get an unknown of their own.

    Every entry, up to `largest` coordinates. Beyond, those within single particles and within small
    groups of coordinates that nothing couples to others; where these are too many, one matrix that
    is the same for all particles.
    """
    n = system.structure.n
    if n <= largest:
        return [(np.array([i]), np.array([j])) for i in range(n) for j in range(n)]
    bodies = particles(system.names)
    within = [list(p.values()) for p in bodies.index]
    within += [list(block) for block in system.structure.blocks if 1 < len(block) <= SMALL_BLOCK]
    entries = sorted({(i, j) for block in within for i in block for j in block})
    if len(entries) <= MOST_ENTRIES:
        return [(np.array([i]), np.array([j])) for i, j in entries]
    pairs = []
    for a in bodies.axes:
        for b in bodies.axes:
            both = [(p[a], p[b]) for p in bodies.index if a in p and b in p]
            if both:
                pairs.append((np.array([i for i, _ in both]), np.array([j for _, j in both])))
    return pairs


def reach(system: System, groups: list[Pairs]) -> str:
    """Which matrices A were looked for, where not all of them."""
    if len(groups) == system.structure.n**2:
        return ""
    alike = any(len(i) > 1 for i, _ in groups)
    which = (
        "that act alike on all particles"
        if alike
        else "within single particles and uncoupled groups"
    )
    return (
        f"{system.structure.n} coordinates: of linear generators only those {which} were looked for"
    )


def name_of(system: System, xi: ca.SX, tau: ca.SX, gauge: ca.SX) -> str:
    """A name for q → q + s (ξ + τ v)."""
    if xi.is_zero():
        return "time translation"
    if not tau.is_zero():
        return f"time translation with {name_of(system, xi, ca.SX(0), gauge)}"
    slope = ca.jacobian(xi, system.q)
    boost = ca.jacobian(xi, system.t)
    zero = ca.SX.zeros(system.q.shape)
    shift = ca.substitute(ca.substitute(xi, system.q, zero), system.t, 0)
    if ca.depends_on(ca.horzcat(slope, boost), ca.vertcat(system.q, system.t)):
        return "nonlinear symmetry"
    if slope.is_zero() and boost.is_zero():
        return _shift_name(system, shift, gauge)
    if slope.is_zero() and shift.is_zero():
        return _along(system, boost, "Galilean boost") or "boost of " + _list_names(system, boost)
    turn = _rotation(system, slope, shift)
    if boost.is_zero():
        return turn or "linear symmetry of " + _list_names(system, ca.sum2(ca.fabs(slope)))
    return f"{turn} in a moving frame" if turn else "affine symmetry"


def _shift_name(system: System, shift: ca.SX, gauge: ca.SX) -> str:
    magnetic = "magnetic " if ca.depends_on(gauge, system.q) else ""
    along = _along(system, shift, f"{magnetic}translation")
    if along:
        return along
    moved = [i for i in range(system.structure.n) if not shift[i].is_zero()]
    if len(moved) == 1 and gauge.is_zero():
        return f"cyclic coordinate {system.names[moved[0]]}"
    return f"{magnetic}translation of {_list_names(system, shift)}"


def _list_names(system: System, vector: ca.SX) -> str:
    moved = [name for i, name in enumerate(system.names) if not ca.densify(vector)[i].is_zero()]
    return ", ".join(moved[:6]) + (", …" if len(moved) > 6 else "")


def _along(system: System, vector: ca.SX, what: str) -> str | None:
    """Name of a shift that is the same for all particles (or for some, which are then listed)."""
    bodies, values = particles(system.names), ca.vertsplit(ca.densify(vector))
    covered = {i for p in bodies.index for i in p.values()}
    if any(not x.is_zero() for i, x in enumerate(values) if i not in covered):
        return None
    moving = [p for p in bodies.index if any(not values[i].is_zero() for i in p.values())]
    parts = {a: [values[p[a]] for p in moving if a in p] for a in bodies.axes}
    if any(not ca.is_equal(x, part[0], 2) for part in parts.values() for x in part[1:]):
        return None
    if len(moving) < len(bodies.index):
        return f"{what} of {_list_names(system, vector)}"
    direction = {a: part[0] for a, part in parts.items() if part and not part[0].is_zero()}
    if len(direction) == 1:
        axis = next(iter(direction))
        return f"{what} along {axis if len(moving) > 1 else system.names[moving[0][axis]]}"
    return f"{what} along ({', '.join(str(direction.get(a, 0)) for a in bodies.axes)})"


def _rotation(system: System, slope: ca.SX, shift: ca.SX) -> str | None:
    """Name of a rotation of all particles alike, of some, or of two coordinates into each other."""
    entries = _entries(system, slope)
    if any(abs(x + entries.get((j, i), 0.0)) > ALIKE * abs(x) for (i, j), x in entries.items()):
        return None
    bodies = particles(system.names)
    turned = [p for p in bodies.index if any(i in p.values() for i, _ in entries)]
    spins = [
        tuple(
            entries.get((p.get(b, -1), p.get(a, -1)), 0.0)
            for a, b in (("y", "z"), ("z", "x"), ("x", "y"))
        )
        for p in turned
    ]
    inside = sum(np.count_nonzero(s) for s in spins) * 2 == len(entries)
    if not inside or np.ptp(spins, axis=0).max() > ALIKE * np.abs(spins).max():
        return _turn_of_coordinates(system, entries)
    axis = spins[0]
    single = np.count_nonzero(axis) == 1
    about = "xyz"[int(np.argmax(np.abs(axis)))] if single else _axis(slope, turned[0])
    if len(turned) < len(bodies.index):
        about += f" of {_list_names(system, ca.sum2(ca.fabs(slope)))}"
    if not shift.is_zero():
        centre = _centre(slope, shift, turned[0], bodies.axes)
        about += f" through {centre}" if centre else " with a shift"
    return f"rotation about {about}"


def _axis(slope: ca.SX, body: dict[str, int]) -> str:
    parts = (slope[body[b], body[a]] for a, b in (("y", "z"), ("z", "x"), ("x", "y")))
    return f"({', '.join(str(part) for part in parts)})"


def _entries(system: System, matrix: ca.SX) -> dict[tuple[int, int], float]:
    """Entries that are not zero, at random values of the parameters."""
    c = np.random.default_rng(0).uniform(0.5, 1.5, system.c.numel())
    values = np.array(ca.Function("entries", [system.c], [ca.densify(matrix)])(c))
    return {(int(i), int(j)): float(values[i, j]) for i, j in np.argwhere(values)}


def _turn_of_coordinates(system: System, entries: dict) -> str | None:
    if len(entries) != 2:
        return None
    (i, j), _ = min(entries.items())
    return f"rotation of {system.names[i]} and {system.names[j]}"


def _centre(slope: ca.SX, shift: ca.SX, body: dict[str, int], axes: str) -> str | None:
    """The fixed point of A q + b for one particle."""
    if not shift.is_constant():
        return None
    index = [body[a] for a in axes if a in body]
    a, b = np.array(ca.DM(slope[index, index])), np.array(ca.DM(shift[index])).ravel()
    x, *_ = np.linalg.lstsq(a, -b, rcond=None)
    if np.abs(a @ x + b).max() > 1e-9:
        return None
    return f"({', '.join(f'{value:.6g}' for value in x + 0.0)})"
