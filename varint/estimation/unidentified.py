"""What the data leave open, in words, with the symmetry that causes it.

A change of parameters and starts that no data of a kind could tell comes from one of these: L and F
are multiplied by a number, perhaps together with a change of units of the coordinates, or do not
change at all; or the starts move along a symmetry of the scene, whose motions go into one another.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.estimation.begin import begun
from varint.estimation.problem import Estimation
from varint.estimation.residuals import parameters_at, start_of
from varint.numerics.arrays import over_columns
from varint.scene.system import System, parameters_by_name
from varint.symmetry.noether import symmetries
from varint.symmetry.symmetry import Symmetry

SAMPLES = 8  # states at which a direction is tried as a scaling
SAME = 1e-6  # relative: directions come from an information matrix with its round-off


def in_words(p: Estimation, rows: np.ndarray, size: np.ndarray, z: np.ndarray) -> tuple[str, ...]:
    """A sentence for each direction that the data leave open, relative to the sizes (open, k); z
    are the estimates of what has a name.
    """
    return tuple(_sentence(p, row * size[: p.many], z[: p.many]) for row in rows)


def _sentence(p: Estimation, change: np.ndarray, z: np.ndarray) -> str:
    there = np.flatnonzero(change)
    names, why = [p.names[i] for i in there], _why(p, change, z)
    if len(names) == 1:
        return f"{names[0]} does not show in the data{why}"
    relative = bool((z[there] != 0).all()) and there.max() < len(p.theta)
    parts = change[there] / z[there] if relative else change[there]
    parts = parts / parts[np.abs(parts).argmax()]
    changes = ", ".join(f"{name} by {x:+.3g}" for name, x in zip(names, parts, strict=True))
    of = " of themselves" if relative else ""
    return (
        f"{', '.join(names[:-1])} and {names[-1]} are not told apart: the data stay as they are "
        f"when {changes}{of} change together{why}"
    )


def _why(p: Estimation, change: np.ndarray, z: np.ndarray) -> str:
    """The symmetry behind a direction, in brackets, where one is found."""
    found = _scaling(p, change, z) or _carried(p, change, z)
    return f" ({found})" if found else ""


def _start_changes(
    p: Estimation, change: np.ndarray, z: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(q0, v0) of every experiment and how a direction changes them, (experiments, 2n)."""
    starts = np.array([start_of(p, m, e, z) for e, m in enumerate(p.motions)])
    moved, many = np.zeros(starts.shape), len(p.theta)
    for row, motion in zip(moved, p.motions, strict=True):
        if motion.begin is not None:
            row += begun(motion.begin, parameters_at(p, z))[1][:, p.theta] @ change[:many]
    if len(p.free):
        moved[:, p.free] += change[many:].reshape(len(starts), -1)
    return starts, moved


def _scaling(p: Estimation, change: np.ndarray, z: np.ndarray) -> str:
    """δL = κ L and δF_i = (κ − w_i) F_i with δq = w q, δv = w v: words for it, or none."""
    s, n = p.system, p.system.structure.n
    starts, moved = _start_changes(p, change, z)
    halves, shifts = starts.reshape(-1, n), moved.reshape(-1, n)
    squares = (halves**2).sum(axis=0)
    weights = (halves * shifts).sum(axis=0) / np.where(squares > 0, squares, 1.0)
    if np.abs(shifts - weights * halves).max() > SAME * max(np.abs(shifts).max(), 1e-300):
        return ""
    c, of_c = p.c.copy(), np.zeros(len(p.c))
    c[p.theta], of_c[p.theta] = z[: len(p.theta)], change[: len(p.theta)]
    values, slopes, terms = _changes(s, starts, weights, c, of_c)
    lagrangian, forces = values[:, 0], values[:, 1:]
    scale = max(np.abs(terms).max(), 1e-300)
    if scale <= 1e-300 or not np.isfinite(terms).all() or not np.isfinite(values).all():
        return ""
    kappa = float(lagrangian @ slopes[:, 0] / max(lagrangian @ lagrangian, 1e-300))
    left = slopes - np.column_stack([kappa * lagrangian, (kappa - weights) * forces])
    if np.abs(left).max() > SAME * scale:
        return ""
    what = "the Lagrangian and the forces" if s.structure.forced else "the Lagrangian"
    if weights.any():
        units = ", ".join(name for name, w in zip(s.names, weights, strict=True) if w)
        return f"a change of the units of {units}, which multiplies {what} as a whole"
    if abs(kappa) * np.abs(lagrangian).max() <= SAME * scale:
        return f"in {what} they stand in other combinations only"
    return f"to multiply {what} as a whole leaves the motion as it is"


def _changes(
    s: System, starts: np.ndarray, weights: np.ndarray, c: np.ndarray, of_c: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(L, F) at states around the starts, how they change, and the sizes of the parts of that."""
    n = s.structure.n
    own, w = ca.densify(ca.vertcat(s.lagrangian, s.force)), ca.DM(weights)
    slopes = [ca.jacobian(own, x) for x in (s.c, s.q, s.v)]
    along = [ca.DM(of_c), w * s.q, w * s.v]
    change = sum(a @ x for a, x in zip(slopes, along, strict=True))
    size = sum(ca.fabs(a) @ ca.fabs(x) for a, x in zip(slopes, along, strict=True))
    outputs = [own, ca.densify(change), ca.densify(size)]
    f = ca.Function("changes", [s.q, s.v, s.t, s.control, s.c], outputs)
    rng = np.random.default_rng(0)
    near = starts[rng.integers(len(starts), size=SAMPLES)]
    x = near + np.maximum(np.abs(near), 0.1) * rng.uniform(-0.5, 0.5, near.shape)
    u = rng.uniform(-1, 1, (SAMPLES, s.structure.controls))
    found = over_columns(f, x[:, :n], x[:, n:], np.full((SAMPLES, 1), 0.3), u, c)
    return found[0], found[1], found[2]


def _carried(p: Estimation, change: np.ndarray, z: np.ndarray) -> str:
    """Symmetries of the scene along which a direction moves the starts, no parameter of the motion
    with them; or none.
    """
    s, many = p.system, len(p.theta)
    starts, moved = _start_changes(p, change, z)
    acting = ca.which_depends(ca.vertcat(s.lagrangian, s.force), s.c, 1, False) if len(p.c) else []
    if not moved.any() or any(acting[p.theta[i]] for i in np.flatnonzero(change[:many])):
        return ""
    c = p.c.copy()
    c[p.theta] = z[:many]
    known = _symmetries(s, c, starts[0, : s.structure.n])
    names: list[str] = []
    for motion, start, shift in zip(p.motions, starts, moved, strict=True):
        fields = np.array([_field(one, start, motion.t0, c) for one in known]).T
        if not shift.any() or not len(known):
            continue
        parts = np.linalg.lstsq(fields, shift, rcond=None)[0]
        size = np.abs(fields * parts).max(axis=0)
        if np.abs(fields @ parts - shift).max() > SAME * np.abs(shift).max():
            return ""
        names += [x.name for x, y in zip(known, size, strict=True) if y > SAME * size.max()]
    every = list(dict.fromkeys(names))
    if not every:
        return ""
    return f"{' and '.join(every)}: a symmetry of the scene, along which motions go into motions"


def _symmetries(s: System, c: np.ndarray, near: np.ndarray) -> list[Symmetry]:
    """Point symmetries that nothing in the scene breaks; none where they cannot be looked for."""
    try:
        found = symmetries(s, params=parameters_by_name(s, c), near=near)
    except InputError:  # too many coordinates, or not defined around the start
        return []
    return [x for x in found if not x.broken_by and x.tau.is_zero()]


def _field(one: Symmetry, start: np.ndarray, t: float, c: np.ndarray) -> np.ndarray:
    """(ξ, dξ/dt) at a state."""
    s = one.system
    rate = ca.jtimes(one.xi, s.q, s.v) + ca.jacobian(one.xi, s.t)
    f = ca.Function("field", [s.q, s.v, s.t, s.c], [ca.densify(ca.vertcat(one.xi, rate))])
    q, v = np.split(start, 2)
    return np.array(f(q, v, t, c)).ravel()
