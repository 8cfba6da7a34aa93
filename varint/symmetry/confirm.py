"""Which of the generators that sampled points allow are symmetries: those whose balance vanishes
identically, and combinations of the others for which it does.

Points see neither a well far away nor a term below rounding errors, so that the null space of the
search may be too large; it is never too small. Within it the exact one is found.
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from varint.symmetry.finite_field import null_space, reconstruct
from varint.symmetry.gauge import quadratic_gauge
from varint.symmetry.identities import P
from varint.symmetry.jumps import moved
from varint.symmetry.sampling import Region
from varint.symmetry.search import Pairs
from varint.symmetry.verify import IDENTICAL, balances, identities, proof


class Draft(NamedTuple):
    """A generator ξ + τ v with its gauge term K."""

    xi: ca.SX
    tau: ca.SX
    gauge: ca.SX


def draft(region: Region, groups: list[Pairs], vector: list, rng: np.random.Generator) -> Draft:
    """The generator with the coefficients (τ, A by groups, b, c)."""
    s, n = region.system, region.system.structure.n
    tau, entries = ca.SX(vector[0]), vector[1 : -2 * n]
    xi = ca.SX.zeros(n)
    for (i, j), x in zip(groups, entries, strict=True):
        if not ca.SX(x).is_zero():
            for a, b in zip(i.tolist(), j.tolist(), strict=True):
                xi[a] += x * s.q[b]
    xi += ca.vertcat(*vector[-2 * n : -n]) + ca.vertcat(*vector[-n:]) * s.t
    return Draft(xi, tau, quadratic_gauge(region, xi, tau, rng))


def confirm(
    region: Region, drafts: list[Draft], jumps: tuple[ca.SX, ...], rng: np.random.Generator
) -> tuple[list[tuple[Draft, str]], int]:
    """The drafts, or combinations of them, that are symmetries, each with how that is known; and
    the number of those that are none. They leave alone where L jumps.
    """
    if not drafts:
        return [], 0
    moving = moves(region, drafts, jumps)
    rows = np.concatenate([balances(region, list(drafts)).rows, *moving])
    crosses = np.any([x.any(axis=0) for x in (*moving, 0 * rows[:1])], axis=0)
    open_ = [int(i) for i in np.flatnonzero(rows.any(axis=0))]
    kept = {i: (x, IDENTICAL.tested) for i, x in enumerate(drafts) if i not in open_}
    basis, free = null_space(rows[:, open_], P)
    lost = 0
    for column, k in zip(basis.T, free, strict=True):
        factors = [reconstruct(int(x), P) for x in column]
        if all(x is not None for x in factors):
            parts = [(float(x), drafts[i]) for x, i in zip(factors, open_, strict=True) if x]
            kept[open_[k]] = (_combine(parts), IDENTICAL.tested)
    for i in (i for i in open_ if i not in kept):
        shown = None if crosses[i] else proof(region, *drafts[i], rng)
        if shown and shown.holds:
            kept[i] = (drafts[i], shown.tested)
        lost += i not in kept
    return [kept[i] for i in sorted(kept)], lost


def moves(region: Region, drafts: list[Draft], jumps: tuple[ca.SX, ...]) -> list[np.ndarray]:
    """For each place where L jumps, values modulo a prime that vanish for generators that leave
    it where it is; a column each.
    """
    s = region.system
    return [
        identities(region, [moved(s, jump, draft.xi, draft.tau) for draft in drafts]).rows
        for jump in jumps
    ]


def _combine(parts: list[tuple[float, Draft]]) -> Draft:
    xi, tau, gauge = (
        sum((factor * x[k] for factor, x in parts[1:]), parts[0][0] * parts[0][1][k])
        for k in range(3)
    )
    return Draft(xi, tau, gauge)
