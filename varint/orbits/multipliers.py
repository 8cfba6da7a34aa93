"""Floquet multipliers of a periodic orbit: those of its symmetries told apart, stability, Krein
signatures.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from varint.errors import InputError
from varint.notation.html import table
from varint.orbits.graded import graded_spectrum
from varint.orbits.reduction import Reduced, reduce, signature, twists
from varint.orbits.shooting import Linear
from varint.scene.structure import Structure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ON_CIRCLE = 1e-7  # |μ| − 1 by the size of the map: what round-off leaves of a multiplier there
TOGETHER = 1e-5  # multipliers this close count as one
LARGE = 10.0  # norm of the map: beyond it small multipliers lose digits in it
ROUNDED = 1e-12  # of the size of the map: the same where it is large


@dataclass(frozen=True, eq=False, repr=False)
class Floquet:
    """Multipliers of a periodic orbit, eigenvalues of its monodromy matrix Φ = ∂x(T)/∂x(0).

    Attributes
    ----------
    multipliers : ndarray of complex (r,)
        Without the trivial ones, the largest first.
    trivial : int
        Multipliers 1 that belong to the flow, to the symmetries and to their integrals.
    blocks : int
        Jordan blocks of size 2 among them: families in which the period, or the phase of a
        symmetry, goes with the value of an integral.
    signatures : tuple of int or None
        Krein signature of each multiplier: ±1 on the unit circle, 0 where a multiple one has both,
        None off the circle, at ±1 and in scenes with forces.
    integrals : tuple of str
        What is conserved.
    size : float
        Norm of Φ: round-off in multipliers is this times that of a number.
    symplectic : bool
    """

    multipliers: np.ndarray
    trivial: int
    blocks: int
    signatures: tuple[int | None, ...]
    integrals: tuple[str, ...]
    size: float
    symplectic: bool

    @cached_property
    def exponents(self) -> np.ndarray:
        """Logarithms of the multipliers; by the period they are Floquet's exponents."""
        return np.log(self.multipliers)

    @cached_property
    def indices(self) -> np.ndarray:
        """Stability indices ν = (μ + 1/μ)/2 of the pairs, (r/2,): real between −1 and 1 where
        stable.
        """
        if not self.symplectic:
            raise InputError("multipliers come in pairs μ, 1/μ only where no forces act")
        found = (self.multipliers + 1 / self.multipliers) / 2
        order = np.argsort(-np.abs(self.multipliers), kind="stable")
        left, kept = list(order), []
        while left:
            i = left.pop(0)
            j = min(left, key=lambda k: abs(self.multipliers[k] - 1 / self.multipliers[i]))
            left.remove(j)
            kept.append(found[i])
        values = np.array(kept)
        return values.real if np.abs(values.imag).max(initial=0.0) < ON_CIRCLE else values

    @property
    def off_circle(self) -> np.ndarray:
        """Multipliers beyond the unit circle by more than round-off."""
        width = max(ON_CIRCLE, ROUNDED * self.size)
        return self.multipliers[np.abs(self.multipliers) > 1 + width]

    @property
    def stable(self) -> bool:
        """Whether no multiplier lies outside the unit circle, and no multiple one of both
        signatures on it.
        """
        return not len(self.off_circle) and 0 not in self.signatures

    @property
    def verdict(self) -> str:
        """Stability in words."""
        out = self.off_circle
        if len(out):
            how = "saddle" if np.abs(out.imag).max() < ON_CIRCLE else "with complex multipliers"
            if len(out) == 1 and out[0].real < 0:
                how = "flip"
            return f"unstable ({how}): grows {np.abs(out).max():.6g}-fold in a period"
        if not self.symplectic:
            inside = np.abs(self.multipliers) < 1 - ON_CIRCLE
            return "asymptotically stable" if inside.all() else "neutral: a multiplier of size 1"
        if not len(self.multipliers):
            return "stable: there is no motion across the orbit but that of its integrals"
        if 0 in self.signatures:
            return "on the brink: multipliers of opposite Krein signatures meet"
        near = np.abs(self.multipliers.imag) < TOGETHER
        if near.any():
            return "on the brink: a multiplier at +1 or −1 besides those of the integrals"
        return "linearly stable: all multipliers on the unit circle"

    def rows(self) -> list[tuple[str, str]]:
        """What is printed: name and value."""
        marks = {1: "Krein +", -1: "Krein −", 0: "Krein ±", None: ""}
        rows = []
        for i, (mu, krein) in enumerate(zip(self.multipliers, self.signatures, strict=True), 1):
            angle = f", angle {np.degrees(np.angle(mu)):.6g}°" if abs(mu.imag) > 0 else ""
            text = f"{mu.real:.10g}{mu.imag:+.10g}i" if abs(mu.imag) > 0 else f"{mu.real:.10g}"
            rows.append(
                (f"μ{i}", f"{text}   |μ| = {abs(mu):.10g}{angle}   {marks[krein]}".rstrip())
            )
        names = ", ".join(self.integrals) or "the flow alone"
        rows.append((f"1 ({self.trivial} times)", f"{names}; {_counted(self.blocks)} of size 2"))
        return rows

    def __repr__(self) -> str:
        return f"Floquet({self.verdict})"

    def __str__(self) -> str:
        return "\n".join([self.verdict, *(f"  {name}  {text}" for name, text in self.rows())])

    def _repr_html_(self) -> str:
        return table(self.verdict, self.rows())

    def plot(self) -> Figure:
        """The multipliers and the unit circle."""
        from varint.drawing.orbit_figures import multipliers_figure

        return multipliers_figure(self.multipliers, self.signatures)


def _counted(blocks: int) -> str:
    """So many Jordan blocks."""
    return "1 Jordan block" if blocks == 1 else f"{blocks or 'no'} Jordan blocks"


def multipliers_of(linear: Linear, names: tuple[str, ...], structure: Structure) -> Floquet:
    """The multipliers of a closed chain of segments."""
    whole, form = linear.monodromy, linear.frames[0].form
    symplectic = not (structure.forced or structure.nonholonomic)
    gradients, directions = linear.gradients, linear.phases[0]
    reduced = reduce(whole, form, gradients, directions)
    size = float(np.linalg.norm(whole, 2))
    values, vectors = _spectrum(linear, reduced)
    order = np.lexsort((-values.imag, -np.round(np.abs(values), 9)))
    values, vectors = values[order].astype(complex), vectors[:, order].astype(complex)
    krein: tuple[int | None, ...] = (None,) * len(values)
    if symplectic:
        width = max(ON_CIRCLE, ROUNDED * size)
        krein = tuple(_krein(values, vectors, i, reduced.form, width) for i in range(len(values)))
    blocks = twists(whole, reduced, gradients, directions)
    trivial = len(whole) - len(values)
    return Floquet(values, trivial, blocks, krein, names, size, symplectic)


def _spectrum(linear: Linear, reduced: Reduced) -> tuple[np.ndarray, np.ndarray]:
    """Multipliers on the reduced space with their vectors: of the product of the segments' maps
    there, which is not multiplied out where multipliers differ by many orders.
    """
    if len(linear.maps) == 1 or np.linalg.norm(reduced.matrix) < LARGE:
        return np.linalg.eig(reduced.matrix)
    rows = [_unit(x) for x in linear.levels], [_unit(x) for x in linear.phases]
    bases = [
        reduce(np.eye(len(one.form)), one.form, gradients, along).basis
        for one, gradients, along in zip(linear.frames, *rows, strict=True)
    ]
    if any(one.shape != reduced.basis.shape for one in bases):
        return np.linalg.eig(reduced.matrix)
    bases[0] = reduced.basis
    ahead = [*bases[1:], bases[0]]
    maps = [b.T @ one @ a for a, one, b in zip(bases, linear.maps, ahead, strict=True)]
    return graded_spectrum(np.array(maps))


def _unit(rows: np.ndarray) -> np.ndarray:
    """Rows of length one."""
    size = np.linalg.norm(rows, axis=1, keepdims=True)
    found: np.ndarray = rows / np.where(size > 0, size, 1.0)
    return found


def _krein(
    values: np.ndarray, vectors: np.ndarray, i: int, form: np.ndarray, width: float
) -> int | None:
    """The signature of a multiplier, of all that are as good as equal to it."""
    mu = values[i]
    if abs(abs(mu) - 1) > width or abs(mu.imag) <= TOGETHER:
        return None
    same = np.abs(values - mu) <= TOGETHER
    return signature(form, np.linalg.qr(vectors[:, same])[0])
