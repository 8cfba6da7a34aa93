"""Where a scene rests: equilibria, with constraints and parameters."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from html import escape
from typing import Any

import numpy as np

from varint.errors import ConvergenceError, InputError
from varint.orbits.modes import NormalModes, normal_modes
from varint.orbits.oscillations import is_regular, linearised
from varint.orbits.rest import Equilibrium, require_restful, rest
from varint.orbits.rest_families import goes_on_along, one_of_each
from varint.orbits.resting import EQUILIBRIA, save_equilibria
from varint.scene.inputs import finite_array, generator, positive_integer, vector
from varint.scene.parameters import ParameterValues
from varint.scene.system import System, parameter_values

SAME = 1e-7  # of the coordinates: equilibria this close are one
TINY = 1e-12  # coordinates and energies that are printed as 0


@dataclass(frozen=True, eq=False, repr=False)
class Equilibria:
    """Equilibria, those of least energy first; iterate, or pick one by number.

    Attributes
    ----------
    items : tuple of Equilibrium
    """

    items: tuple[Equilibrium, ...]

    def __len__(self) -> int:
        return len(self.items)

    def __iter__(self) -> Iterator[Equilibrium]:
        return iter(self.items)

    def __getitem__(self, which: int) -> Equilibrium:
        return self.items[which]

    @cached_property
    def modes(self) -> tuple[NormalModes, ...]:
        """Small oscillations about each."""
        return tuple(normal_modes(one.system, one) for one in self)

    @cached_property
    def verdicts(self) -> tuple[str, ...]:
        """Stability of each in words."""
        return tuple(
            normal_modes(one.system, one).verdict
            if is_regular(linearised(one).mass)
            else "unknown: the coordinates describe no motions about it"
            for one in self
        )

    @cached_property
    def goes_on(self) -> tuple[tuple[str, ...], ...]:
        """The coordinates along which other equilibria follow each: one of a curve or surface of
        them, as a bead has that nothing pushes along a wire. Empty of isolated ones.
        """
        return tuple(goes_on_along(one) for one in self)

    def save(self, path: Any) -> None:
        """Write them with their scene to one ``.npz`` file, which `varint.load` reads."""
        save_equilibria(path, EQUILIBRIA, self.items)

    def rows(self) -> list[tuple[str, ...]]:
        """Head and rows of the table: coordinates, energy, stability."""
        head = (*self.items[0].system.names, "energy", "stability")
        rows = [
            (*(_short(x) for x in one.q), _short(one.energy), words + _said(names))
            for one, words, names in zip(self, self.verdicts, self.goes_on, strict=True)
        ]
        return [head, *rows]

    def __repr__(self) -> str:
        return f"Equilibria({len(self)})"

    def __str__(self) -> str:
        rows = self.rows()
        wide = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
        lines = [
            "  ".join(f"{x:<{w}}" for x, w in zip(row, wide, strict=True)).rstrip() for row in rows
        ]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        head, *rows = ([f"<td>{escape(x)}</td>" for x in row] for row in self.rows())
        lines = "".join(f"<tr>{''.join(row)}</tr>" for row in (head, *rows))
        return f"<table>{lines}</table>"


def equilibria(
    system: System,
    guess: Any = None,
    *,
    box: Any = None,
    starts: int = 100,
    params: ParameterValues | None = None,
    seed: int = 0,
) -> Equilibria:
    """Where the scene rests: ∂L/∂q(q, 0) + F(q, 0) + Gᵀλ = 0, g(q) = 0.

    Newton's method with exact second derivatives, in the least-squares sense where equilibria form
    curves, as along a symmetry.

    Parameters
    ----------
    system : System
        Autonomous, without contacts and controls.
    guess : array (n,) or (k, n), optional
        Near which to look: one equilibrium each.
    box : dict of pairs, or array (n, 2), optional
        Lower and upper bounds of the coordinates, ``{"theta": (-4, 4)}``, in which to look from
        `starts` random configurations; coordinates left out of a dictionary are 0 at the start and
        unbounded. What is found is complete only as far as the starts reach; of equilibria that
        go on along a line, a curve or a surface one is given (`Equilibria.goes_on` has the
        coordinates), or some where the starts leave wide gaps.
    starts, seed : int
    params : dict, optional
        Parameter values that differ from the defaults, by name or symbol.

    Returns
    -------
    Equilibria
        Each once; prints as a table with stability in words.

    Raises
    ------
    InputError
        If neither guess nor box is given, or the scene has no rest.
    ConvergenceError
        If no equilibrium is found near a guess, or in the box.

    Examples
    --------
    >>> import casadi as ca
    >>> import varint as vi
    >>> q, v = vi.coordinates("theta")
    >>> pendulum = vi.System(q, v, v**2 / 2 + ca.cos(q))
    >>> found = vi.orbits.equilibria(pendulum, [[0.3], [3.0]])
    >>> print(found)
    theta        energy  stability
    0            -1      stable: the energy is definite there (Lagrange–Dirichlet)
    3.141592654  1       unstable: grows e-fold in 1
    """
    require_restful(system)
    c = parameter_values(system, params)
    if (guess is None) == (box is None):
        raise InputError("give guess=, near which to look, or box=, in which to look")
    if box is None:
        n = system.structure.n
        rows = finite_array("guess", guess)
        rows = rows.reshape(1, -1) if rows.ndim < 2 else rows
        found = [rest(system, vector("guess", row, n, system.names), c) for row in rows]
        return _sorted(found)
    low, high = _bounds(system, box)
    many, random = positive_integer("starts", starts), generator(seed)
    inside = np.isfinite(low) & np.isfinite(high)
    places = np.zeros((many, len(low)))
    for start in places:
        start[inside] = random.uniform(low[inside], high[inside])
    found, failure = [], None
    for start in places:
        try:
            one = rest(system, start, c)
        except ConvergenceError as error:
            failure = error
            continue
        margin = SAME * np.maximum(np.abs(one.q), 1.0)
        if (one.q >= low - margin).all() and (one.q <= high + margin).all():
            found.append(one)
    if not found:
        raise failure or ConvergenceError(
            f"no equilibrium lies in the box, as far as {many} starts tell",
            step=0,
            time=0.0,
            residual=float("nan"),
        )
    return _sorted(one_of_each(list(_sorted(found)), places))


def _sorted(found: list[Equilibrium]) -> Equilibria:
    kept: list[Equilibrium] = []
    for one in found:
        size = max(float(np.abs(one.q).max()), 1.0)
        if all(np.abs(one.q - other.q).max() > SAME * size for other in kept):
            kept.append(one)
    return Equilibria(tuple(sorted(kept, key=lambda x: x.energy)))


def _bounds(system: System, box: Any) -> tuple[np.ndarray, np.ndarray]:
    n, names = system.structure.n, system.names
    low, high = np.full(n, -np.inf), np.full(n, np.inf)
    if isinstance(box, Mapping):
        if unknown := sorted(set(map(str, box)) - set(names)):
            raise InputError(f"box names {unknown}; the coordinates are {list(names)}")
        for name, pair in box.items():
            ends = finite_array(f"box[{name!r}]", pair)
            if ends.shape != (2,):
                raise InputError(f"box[{name!r}] must be a pair (lower, upper), got {pair!r}")
            low[names.index(name)], high[names.index(name)] = ends
    else:
        ends = finite_array("box", box)
        if ends.shape != (n, 2):
            raise InputError(f"box has shape {ends.shape}; it must be ({n}, 2): lower, upper")
        low, high = ends.T
    if (low > high).any():
        raise InputError("box has a lower bound above its upper one")
    if (low == high).all():
        raise InputError("box is a point: it takes a pair (lower, upper) for each coordinate")
    return low, high


def _said(names: tuple[str, ...]) -> str:
    """What is added of one that is not alone."""
    return f"; one of many, which go on along {', '.join(names)}" if names else ""


def _short(x: float) -> str:
    return f"{x if abs(x) > TINY else 0.0:.10g}"
