"""Poincaré sections: where motions cross a surface, with the accuracy of their rule."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from varint.ensembles.result import Ensemble
from varint.errors import InputError
from varint.integration.backend import kernel_for
from varint.integration.events.crossings import crossing_search, parse_watch
from varint.integration.events.native_crossings import crossings_by
from varint.integration.problem import InitialValueProblem
from varint.numerics.arrays import over_columns
from varint.numerics.progress import progress_bar
from varint.orbits.energy_boundary import energy_left
from varint.orbits.files import save
from varint.results.trajectory import Trajectory
from varint.scene.expressions import in_own_symbols
from varint.scene.system import System

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ALIKE = 1e-6  # of the energies' size: motions on one energy surface


@dataclass(frozen=True, eq=False)
class Section:
    """Where motions cross a surface.

    Attributes
    ----------
    motion : ndarray of int (K,)
        Which motion each crossing belongs to.
    t : ndarray (K,)
        When.
    q, v, p : ndarray (K, n)
        The states there.
    points : ndarray (K, 2)
        What is shown of them.
    names : tuple of str
        Of both axes.
    title : str
    boundary : tuple of ndarray, or empty
        For motions of one energy in two coordinates: a grid of both axes, (A,) and (B,), and
        E − min H on it, (B, A), negative where no motion of this energy comes.
    """

    motion: np.ndarray
    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    p: np.ndarray
    points: np.ndarray
    names: tuple[str, ...]
    title: str
    boundary: tuple[np.ndarray, ...]

    def __len__(self) -> int:
        return len(self.t)

    def __repr__(self) -> str:
        if not len(self):
            return "Section(no crossings)"
        motions = len(np.unique(self.motion))
        many, all_of = ["s" if count > 1 else "" for count in (len(self), motions)]
        return f"Section({len(self)} crossing{many} of {motions} motion{all_of})"

    def of(self, motion: int) -> np.ndarray:
        """The points (k, 2) of one motion, in the order of time."""
        return self.points[self.motion == motion]

    def plot(self) -> Figure:
        """The points, each motion in a colour of its own, within what its energy allows."""
        from varint.drawing.chaos_figures import section_figure

        groups = [self.of(i) for i in np.unique(self.motion)]
        names = self.names[0], self.names[1]
        boundary = (self.boundary[0], self.boundary[1], self.boundary[2]) if self.boundary else None
        return section_figure(groups, names, self.title, boundary)

    def save(self, path: Any) -> None:
        """Write it to one ``.npz`` file, which `varint.load` reads."""
        save(self, path)


def poincare_section(
    motions: Trajectory | Ensemble | Sequence[Trajectory],
    surface: ca.SX | str,
    *,
    direction: int = 1,
    show: Sequence[ca.SX] | None = None,
    progress: bool | None = None,
) -> Section:
    """Where motions cross the surface g(q, v, t) = 0, none lost and each located with the rule's
    own accuracy.

    Between two nodes the motion is a shorter step of the same rule, and the time of the crossing
    is solved for until g is zero to round-off: no interpolation enters. Bounds on g over every step
    tell that no pair of crossings is missed.

    Parameters
    ----------
    motions : Trajectory, Ensemble or sequence of Trajectory
        With every step kept (``save_every=1``).
    surface : SX or str
        Expression of q, v, t and the parameters. For long runs, of which few nodes are kept: the
        name under which their crossings were logged, ``simulate(..., events={"section":
        (surface, 1)})``. A period T of the time: ``ca.sin(2 * ca.pi * t / T)``.
    direction : {1, -1, 0}
        Only where g rises, only where it falls, or both.
    show : (SX, SX), optional
        What the axes are. Default: with two coordinates, one of which the surface fixes, the other
        one and its momentum; with one, q and p.
    progress : bool, optional
        As for `simulate`, over the motions.

    Returns
    -------
    Section

    Raises
    ------
    InputError
        If nodes were left out, no crossing of that name was logged, or it is not known what to
        show.

    References
    ----------
    Hénon & Heiles, Astronomical Journal 69 (1964) 73; the time as an unknown of the last step in
    place of interpolation: Hénon, Physica D 5 (1982) 412.

    Examples
    --------
    >>> import varint as vi
    >>> model = vi.models.henon_heiles()
    >>> q, v = model.system.q, model.system.v
    >>> starts = vi.orbits.starts_at_energy(
    ...     model.system, 1 / 12, q0=[[0, 0.1], [0, 0.3]], v0=[0, 0], free=v[0]
    ... )
    >>> runs = vi.ensemble(model.system, vi.gauss(6), **starts, h=0.2, steps=1000)
    >>> section = vi.orbits.poincare_section(runs, q[0])
    >>> section, bool(abs(section.q[:, 0]).max() < 1e-13)
    (Section(64 crossings of 2 motions), True)
    """
    each = [motions] if isinstance(motions, Trajectory) else motions
    if not isinstance(each, (Ensemble, Sequence)) or not len(each):
        raise InputError(
            f"a motion, several or an ensemble is wanted, got {type(motions).__name__}"
        )
    first = _checked(each[0])
    system = first.system
    found, energies = [], []
    if isinstance(surface, str):
        _logged(first, surface, direction)
    axes = _axes(system, surface, show)
    with progress_bar(len(each), "motion", progress) as move:
        for i, motion in enumerate(_every(each)):
            if motion.system is not system:
                raise InputError("all motions must be of one system")
            states = _logged(motion, surface, direction)
            if states is None:
                states = crossings(motion, surface, direction)
            found.append((np.full(len(states[0]), i), *states))
            energies.append(motion.energy[0])
            move(1, lambda: "")
    which, t, q, v, p = (np.concatenate(x) for x in zip(*found, strict=True))
    shown = ca.Function(
        "shown", [system.q, system.v, system.t, system.c], [ca.densify(ca.vertcat(*axes[0]))]
    )
    points = over_columns(shown, q, v, t[:, None], first.c)[0] if len(t) else np.zeros((0, 2))
    boundary: tuple[np.ndarray, ...] = ()
    level = float(np.mean(energies))
    one = np.ptp(energies) <= ALIKE * max(abs(level), float(np.abs(energies).max()), 1e-300)
    title = f"{len(t)} crossings"
    if one and system.structure.autonomous and not system.structure.forced:
        title += f", E = {level:.6g}"
        if axes[2] is not None and not isinstance(surface, str) and len(t):
            own = in_own_symbols(surface, system)
            boundary = energy_left(system, own, axes[2], level, q, points, first.c)
    return Section(which, t, q, v, p, points, axes[1], title, boundary)


def _every(each: Any) -> Iterable[Trajectory]:
    return (_checked(motion) for motion in each)


def _checked(motion: Any) -> Trajectory:
    if not isinstance(motion, Trajectory):
        raise InputError(f"motions come from simulate() or ensemble(), got {type(motion).__name__}")
    return motion


States = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def _logged(motion: Trajectory, surface: Any, direction: int) -> States | None:
    """The crossings that the run has logged under a name; None where an expression is given."""
    if not isinstance(surface, str):
        return None
    events = [event for event in motion.events if event.kind == surface]
    if not events:
        known = sorted({event.kind for event in motion.events})
        raise InputError(
            f"the run has logged no crossing named {surface!r}, but {known}; run it with "
            f"events={{{surface!r}: (expression, {direction})}}"
        )
    n = motion.q.shape[1]
    columns = [[getattr(event, name) for event in events] for name in ("q", "v_after", "p_after")]
    q, v, p = (np.array(x).reshape(-1, n) for x in columns)
    return np.array([event.time for event in events]), q, v, p


def crossings(motion: Trajectory, surface: Any, direction: int) -> States:
    """The crossings between the nodes of a motion: t, q, v, p.

    Raises
    ------
    InputError
        If nodes were left out, or steps were of a fictitious time.
    """
    if motion.fictitious is not None:
        raise InputError(
            "this run took its steps in a fictitious time: log its crossings on the way, "
            'simulate(..., events={"section": (surface, 1)}), and give the name "section"'
        )
    if (np.diff(motion.k) > 1).any():
        raise InputError(
            "some steps of this run were not kept: run it with save_every=1, or with "
            'events={"section": (surface, 1)}, and give the name "section"'
        )
    watch = parse_watch("the surface", (surface, direction))
    problem = InitialValueProblem(
        motion.q[0],
        motion.p[0],
        float(motion.t[0]),
        motion.h,
        int(motion.k[-1]) or 1,
        1,
        motion.u,
        motion.c,
        len(motion.rule.nodes),
    )
    kernel = None
    if not (motion.system.structure.contacts or motion.active_sets):
        kernel = kernel_for(motion.system, motion.rule, problem, "auto")
    search = crossing_search(motion.system, watch)
    at = crossings_by(kernel, search, motion, {}).after
    return at.t, at.q, at.v, at.p


def _axes(
    system: System, surface: Any, show: Any
) -> tuple[list[ca.SX], tuple[str, ...], int | None]:
    """Both expressions, their names, and the coordinate shown beside its momentum where that is
    what is shown of two.
    """
    s, n = system, system.structure.n
    if show is not None:
        if not isinstance(show, (tuple, list)) or len(show) != 2:
            raise InputError(f"show must be two expressions, got {show!r}")
        from varint.drawing.style import named_expressions

        named = named_expressions(show, s)
        return [in_own_symbols(x, s) for _, x in named], tuple(name for name, _ in named), None
    shown: int | None = None
    if n == 1:
        shown = 0
    elif n == 2 and isinstance(surface, ca.SX):
        own = in_own_symbols(surface, s)
        fixed = [i for i in range(2) if ca.depends_on(own, s.q[i])]
        if len(fixed) == 1 and not ca.depends_on(own, ca.vertcat(s.v, s.t)):
            shown = 1 - fixed[0]
    if shown is None:
        raise InputError(
            "say what to show: show=(a, b), two expressions of q, v, t and the parameters, such as "
            "(system.q[1], system.momentum[1])"
        )
    from varint.drawing.style import label

    name = label(s.names[shown])
    momentum = f"$p_{{{name.strip('$')}}}$"
    return [s.q[shown], s.momentum[shown]], (name, momentum), shown if n == 2 else None
