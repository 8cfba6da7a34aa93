"""The one result: what simulation, least action and optimal control return."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from varint.discrete.constraints import ActiveSet, every_row_function, multipliers_along
from varint.discrete.legendre import velocity_function
from varint.errors import InputError, renamed_attribute
from varint.numerics.arrays import over_columns
from varint.results.records import (
    EVENTS,
    FICTITIOUS,
    Costates,
    State,
    StepsAgain,
    arrive,
    changed,
    checked_index,
    leans,
    made_at_first_look,
    require_motion,
    state_of,
    whole_of,
)
from varint.rules.rule import Rule
from varint.scene.expressions import values_of
from varint.scene.inputs import times_of
from varint.scene.rays import make_nodes_unit
from varint.scene.system import System, parameters_by_name

if TYPE_CHECKING:
    from matplotlib.animation import FuncAnimation
    from matplotlib.figure import Figure

    from varint.diagnostics.momentum import Conserved, MomentumMap
    from varint.drawing.sketch import Sketch
    from varint.symmetry.symmetry import Symmetry


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory:
    """A motion at its nodes; arrays have time first.

    Attributes
    ----------
    system, rule : System, Rule
        What moved, and by which discretisation.
    t : ndarray (N + 1,)
        Times of the nodes.
    q, p : ndarray (N + 1, n)
        Coordinates and momenta ∂L/∂v.
    h : float
        Step size, or the mean one where steps differ (`sizes`); nodes may be several steps apart
        (`k`).
    k : ndarray of int (N + 1,)
        Number of whole steps before each node.
    u : ndarray (steps, r, controls)
        Controls of every step at the rule's nodes; r = 1 where they are constant on a step.
    c : ndarray
        Parameter values, in the order of ``system.c``.
    functions : StepsAgain
        How its steps are taken once more, built when first needed.
    active_sets : tuple of ActiveSet
        Which rows and contacts held at one time or another; empty where all constraints held all
        the time.
    active_set : ndarray of int (N + 1,)
        Index of the active set that begins or goes on at each node.
    events : tuple of Event
        What happened on the way, in order of time.
    stats : mapping
        Plan, worst residual, timings, and the iterations that solved its steps (0 where steps are
        explicit).
    fictitious : Trajectory or None
        The same nodes in fictitious time, for runs with a time scale: coordinates (q, t), ``t``
        holds τ.
    dense_output : callable or None
        (trajectory, times) → the trajectory with nodes at the times, of a run in fictitious time
        or a path that leans on bounds.
    solution : ControlSolution, ActiveBounds or None
        What an optimal control has beside its motion: cost, costates, active bounds, the solver's
        way; or where a path of least action leans on its bounds.
    closure : ndarray (n, n + 1) or None
        [S | b] of a path that was found closed, q(T) = S q(0) + b; see `least_action`.
    sizes : ndarray (steps,) or None
        Size of every step, where they are not all `h`.
    origin : float or None
        Time of step 0 of the grid; events lie within its steps.
    whole : Trajectory or None
        The motion with all its nodes, where steps from those that are left would not know of
        impacts, or of controls that act, between them.
    """

    system: System
    rule: Rule
    t: np.ndarray
    q: np.ndarray
    p: np.ndarray
    h: float
    k: np.ndarray
    u: np.ndarray
    c: np.ndarray
    functions: StepsAgain
    active_sets: tuple[ActiveSet, ...] = ()
    active_set: np.ndarray | None = None
    events: tuple = EVENTS
    stats: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    fictitious: Trajectory | None = FICTITIOUS
    dense_output: Callable[[Trajectory, np.ndarray], Trajectory] | None = None
    solution: Any = None
    closure: np.ndarray | None = None
    sizes: np.ndarray | None = None
    origin: float | None = None
    whole: Trajectory | None = None

    def __post_init__(self) -> None:
        make_nodes_unit(self)

    phases = renamed_attribute("phases", "active_sets")
    phase = renamed_attribute("phase", "active_set")

    if not TYPE_CHECKING:
        __getattr__ = made_at_first_look

    def __len__(self) -> int:
        return len(self.t)

    def __repr__(self) -> str:
        names, ends = self.system.names, f"t = {self.t[0]:g} … {self.t[-1]:g}"
        what = ", ".join(names[:4]) + (", …" if len(names) > 4 else "")
        return f"Trajectory({what}: {len(self)} nodes, {ends}, {self.rule})"

    def _repr_html_(self) -> str:
        """For notebooks: a short table and a small picture."""
        from varint.drawing.notebook import trajectory_html

        return trajectory_html(self)

    def __getstate__(self) -> dict[str, Any]:
        """What travels to another process or into a copy: the fields, not what follows from
        them; and an action that was found with the path.
        """
        return state_of(self)

    __setstate__ = arrive

    def __getitem__(self, index: int | slice | np.ndarray | list | str) -> Any:
        """`trajectory[i]` is the `State` at node i, `trajectory[a:b:c]` the trajectory of those
        nodes, `trajectory["theta"]` the values (N + 1,) of what has that name.
        """
        if isinstance(index, str):
            return self.value(index)
        index = checked_index(index, len(self))
        if isinstance(index, (slice, np.ndarray)):
            if not len(self.t[index]):
                raise InputError(f"no node of the {len(self)} is left in [{index}]")
            part = changed(
                self,
                **{name: getattr(self, name)[index] for name in ("t", "q", "p", "k")},
                active_set=None if self.active_set is None else self.active_set[index],
                fictitious=None if self.fictitious is None else self.fictitious[index],
                closure=None,
                whole=whole_of(self),
                # controls belong to the whole
                solution=None if hasattr(self.solution, "total_cost") else self.solution,
            )
            if "v" in self.__dict__:  # once known, known of every part
                part.__dict__["v"] = self.v[index]
            return part
        return State(float(self.t[index]), self.q[index], self.v[index], self.p[index])

    @cached_property
    def v(self) -> np.ndarray:
        """Velocities (N + 1, n), from the momenta by the inverse Legendre transform."""
        v = np.empty_like(self.q)
        for nodes, active_set in self._active_sets():
            velocity = velocity_function(active_set.scene(self.system))
            args = self.q[nodes], self.p[nodes], self.t[nodes, None], self.c
            v[nodes] = over_columns(velocity, *args)[0]
        return v

    def _active_sets(self) -> list[tuple[Any, ActiveSet]]:
        """Nodes of each active set, and the set."""
        if self.active_set is None:
            return [(slice(None), ActiveSet(tuple(range(self.system.structure.constraints))))]
        return [
            (np.flatnonzero(self.active_set == i), self.active_sets[i])
            for i in np.unique(self.active_set)
        ]

    @cached_property
    def multipliers(self) -> np.ndarray:
        """Physical multipliers λ at every node, (N + 1, m): constraints, then non-holonomic rows,
        then contacts.

        They follow from q and v at the node by the twice differentiated constraints, so they have
        the order of q and v (Hairer & Wanner II, VII.1: the index-1 relation). Contacts that do not
        touch have λ = 0.
        """
        from varint.results.dense_output import controls_at_nodes

        rows, u = self.system.structure, controls_at_nodes(self)
        if rows.constraints:
            require_motion(self, "what these add to the multipliers is not known")
        lam = np.zeros((len(self), rows.constraints + rows.nonholonomic + rows.contacts))
        for nodes, active_set in self._active_sets():
            args = self.q[nodes], self.v[nodes], u[nodes], self.t[nodes], self.c
            lam[nodes] = multipliers_along(self.system, active_set, *args)
        return lam

    @cached_property
    def reaction_forces(self) -> np.ndarray:
        """Forces Wᵀλ by which constraints and contacts hold the motion, in the coordinates q, (N
        + 1, n).
        """
        lam = self.multipliers
        slope = over_columns(
            every_row_function(self.system), self.q, self.v, self.t[:, None], self.c
        )[1]
        return np.einsum("ijk,ik->ij", slope.reshape(*self.q.shape, -1), lam)

    @property
    def duration(self) -> float:
        """Time from the first node to the last."""
        return float(self.t[-1] - self.t[0])

    @property
    def parameters(self) -> dict[str, np.ndarray]:
        """Parameter values of this run by name."""
        return parameters_by_name(self.system, self.c)

    def value(self, expression: Any) -> np.ndarray:
        """Value of any expression of q, v, t, the controls and the parameters at every node.

        Parameters
        ----------
        expression : SX or str
            Symbols are matched by name with the system's, so this works on loaded trajectories too;
            a name alone stands for its symbol.

        Returns
        -------
        ndarray (N + 1,) or (N + 1, k) or (N + 1, k, l)
            For a scalar, a column of k, a k × l matrix. Controls are those of the step that begins
            at the node (at the last node: of the step that ends there).

        Raises
        ------
        InputError
            If the expression has symbols that the system does not know.
        """
        return self.evaluated(self.function_of(expression))

    def function_of(self, expression: Any) -> ca.Function:
        """(q, v, t, u, c) → an expression of the system's symbols, matched by name."""
        return values_of(self.system, expression)

    def evaluated(self, function: ca.Function) -> np.ndarray:
        """Values at every node of what `function_of` returned."""
        from varint.results.dense_output import controls_at_nodes

        flat = over_columns(
            function, self.q, self.v, self.t[:, None], controls_at_nodes(self), self.c
        )[0]
        rows, columns = function.size_out(0)
        if columns == 1:
            return flat[:, 0] if rows == 1 else flat
        return flat.reshape(len(self), columns, rows).transpose(0, 2, 1)

    @cached_property
    def energy(self) -> np.ndarray:
        """Energy H = v·∂L/∂v − L at every node, (N + 1,)."""
        return self.value(self.system.energy)

    @cached_property
    def action(self) -> float:
        """Discrete action Σ L_d over all steps of the trajectory."""
        if (inner := self.fictitious) is not None:
            from varint.results.fictitious_action import action_of as along_fictitious

            return along_fictitious(self, inner)
        if leans(self):
            from varint.results.leaning import action_of

            return action_of(self)
        return float(self.sums(self.functions.action).sum())

    def sums(self, integrand: Callable[[System], ca.Function]) -> np.ndarray:
        """Sums over the steps between nodes of ``integrand(system)``: (q0, p0, u, params, t, h)
        → numbers, (N, k).
        """
        if self.fictitious is not None:
            raise InputError(
                "the steps of this run are steps of its fictitious time; sum along "
                "trajectory.fictitious"
            )
        from varint.results.dense_output import sums_between

        return sums_between(self, integrand)

    def momentum_map(self, symmetry: Symmetry) -> MomentumMap:
        """The conserved quantity J of a symmetry along the motion: values, drift, slope, and the
        balance with forces.

        Parameters
        ----------
        symmetry : Symmetry
            From `symmetries` or `noether`, of this trajectory's system.

        Returns
        -------
        MomentumMap
            With forces also the change that they must cause, J_N − J_0 = Σ (f⁻·ξ(q_k) +
            f⁺·ξ(q_{k+1})).

        Raises
        ------
        InputError
            If the symmetry is one of another system, or of other parameter values.
        """
        from varint.diagnostics.momentum import momentum_map

        return momentum_map(self, symmetry)

    def conserved(self) -> Conserved:
        """Every symmetry of the Lagrangian at this run's parameter values, with its quantity's
        drift and slope.
        """
        from varint.diagnostics.momentum import conserved

        return conserved(self)

    @cached_property
    def morse_index(self) -> int:
        """Number of independent variations with fixed ends that lower the action: 0 for a path of
        least action.

        A path that was found closed is varied among closed paths, and shifts and turns of the whole
        do not count.

        Raises
        ------
        InputError
            If the scene has forces (no action is stationary then) or not every step was kept.
        """
        from varint.diagnostics import second_variation

        return second_variation.morse_index(self)

    @cached_property
    def conjugate_times(self) -> np.ndarray:
        """Times conjugate to the start, where ∂q(t)/∂p(0) is singular, located with the rule's
        accuracy, (count,).

        Raises
        ------
        InputError
            As for `morse_index`.
        """
        from varint.diagnostics import second_variation

        return second_variation.conjugate_times(self)

    @property
    def is_minimum(self) -> bool:
        """Whether no variation with fixed ends lowers the action to second order: Morse index 0."""
        return self.morse_index == 0

    def transition_matrix(self, k0: int = 0, k1: int = -1) -> np.ndarray:
        """Exact derivative of the discrete motion, Φ = ∂(q, p)_{k1}/∂(q, p)_{k0}.

        The product of the steps' derivatives by the implicit function theorem, and of impacts'
        saltation matrices, at the times of both nodes; ΦᵀJΦ = J with J = [[0, 1], [−1, 0]] where
        there are no forces (Marsden & West 2001, §1.3).

        Parameters
        ----------
        k0, k1 : int
            Indices of nodes, k0 not after k1; negative ones count from the end.

        Returns
        -------
        ndarray (2n, 2n)

        Raises
        ------
        InputError
            If there is no such node, or node k0 lies within a step.
        ConvergenceError
            If the motion grazes a contact.

        Examples
        --------
        >>> import numpy as np
        >>> import varint as vi
        >>> q, v = vi.coordinates("x")
        >>> motion = vi.simulate(vi.System(q, v, v**2 / 2), q0=0.0, v0=1.0, h=0.5, steps=4)
        >>> motion.transition_matrix().tolist()
        [[1.0, 2.0], [0.0, 1.0]]
        """
        from varint.sensitivities.tangents import transition_matrix

        return transition_matrix(self, k0, k1)

    def at(self, t: Any, side: str = "after") -> Any:
        """Dense output as accurate as the nodes: a sub-step of the same rule from the node before
        each time.

        Where many times (32 or more in all, three or more in a step) are asked of a motion by
        Gauss rules of four stages or more, each step that holds them is taken once more by
        `gauss(16)`, whose stages tell what lies between as far as round-off, or as a quarter of
        what the step itself errs by; else its times are reached by sub-steps as well.

        ``q(t_k + x h) = q_k + h ∫ q̇ from 0 to x + (q_{k+1} − q'_{k+1}) x^(2s+1)``, where that
        step ends in q'_{k+1} and the motion's own, of s stages, in q_{k+1}.

        Parameters
        ----------
        t : float or array (k,)
            Times within the trajectory.
        side : {"after", "before"}
            Where the motion jumps, at impacts: the state in which it goes on, or in which it comes
            there. Elsewhere both are the same up to round-off.

        Returns
        -------
        State or Trajectory
            A `State` for a number, a `Trajectory` with nodes at the times for an array.

        Raises
        ------
        InputError
            If a time lies outside the trajectory, or the side is neither of the two.
        """
        if side not in ("after", "before"):
            raise InputError(f"side must be 'after' or 'before', got {side!r}")
        times = times_of(t)
        if self.dense_output is not None:  # whoever made it knows its clock, or its bounds
            found = self.dense_output(self, times)
        else:
            from varint.results.dense_output import nodes_at

            found = nodes_at(self, times, side)
        return found[0] if np.ndim(t) == 0 else found

    @property
    def cost(self) -> float:
        """Cost of an optimal control, terminal cost included."""
        return self._solution("cost").cost

    @property
    def costates(self) -> Costates:
        """Costates of an optimal control: derivatives of the cost-to-go with respect to q and p,
        (N + 1, n) each.
        """
        return self._solution("costates").costates

    def u_at(self, t: Any) -> np.ndarray:
        """Controls of an optimal control at any times within it, by the polynomial of each step,
        (k,) or (M, k).
        """
        times = times_of(t)
        if not self.system.structure.controls:
            raise InputError("u_at(): the scene has no controls")
        first, last = self.t[[0, -1]]
        slack = 1e-12 * max(abs(first), abs(last))
        if not ((times >= first - slack) & (times <= last + slack)).all():
            raise InputError(f"u_at() takes times from {first:g} to {last:g}, got {t!r}")
        found = self._solution("u_at()").u((times - first) / self.duration)
        return found[0] if np.ndim(t) == 0 else found

    def replay(self) -> Trajectory:
        """`simulate` from the optimal start with the optimal controls: the same motion to
        round-off.
        """
        return self._solution("replay()").replay(self)

    @property
    def again(self) -> Any:
        """The problem of an optimal control, ready for other numbers: nothing is built anew, and
        the solver starts warm from this solution.

        ``motion.again(end=dict(q=[2]))`` solves it with another end, ``params=dict(mass=2)`` with
        other parameters; see `Prepared` for all that may change. Several phases come back as a
        list. `report` estimates the error of what it returns when it is asked for.
        """
        return self._solution("again()").again(self)

    def report(self) -> None:
        """Print how an optimal control was found and what it keeps: cost, violation, replay,
        energy, momenta.
        """
        print(self._solution("report()").report(self))

    def _solution(self, what: str) -> Any:
        if not hasattr(self.solution, "total_cost"):
            raise InputError(f"{what} belongs to trajectories that optimal_control returned")
        return self.solution

    def plot(self, *expressions: Any) -> Figure:
        """Figure of coordinates, phase portrait and energy; or of expressions (or names of
        coordinates, velocities, controls) over time, which a dictionary gives names.
        """
        from varint.drawing.figures import trajectory_figure

        return trajectory_figure(self, *expressions)

    def animate(
        self,
        path: Any = None,
        *,
        sketch: Sketch | None = None,
        speed: float = 1.0,
        fps: float = 25.0,
        trace: float | None = None,
    ) -> FuncAnimation:
        """Film of the motion, true to time: `speed` units of time a second.

        Parameters
        ----------
        path : str or Path, optional
            Where to write it, ending in .gif, .mp4 (needs ffmpeg) or .html.
        sketch : Sketch, optional
            What to draw. Default: the bodies of a scene whose coordinates are called x, y (, z) or
            x1, y1, x2, …
        speed : float
            Time of the motion per second of film.
        fps : float
            Frames a second; of a gif the nearest that it can keep.
        trace : float, optional
            Length of the traces in time; default: all of the past.

        Returns
        -------
        matplotlib.animation.FuncAnimation
            As the value of a notebook's cell it plays inside; ``HTML(film.to_jshtml())`` has
            buttons.

        Raises
        ------
        InputError
            If it is not known what to draw, the file's kind is unknown, or ffmpeg is missing.
        """
        from varint.drawing.animation import trajectory_animation

        return trajectory_animation(self, path, sketch=sketch, speed=speed, fps=fps, trace=trace)

    def save(self, path: Any) -> None:
        """Write everything to one compressed ``.npz`` file without pickle; `varint.load` reads
        it.
        """
        from varint.results.save import save

        save(self, path)

    def to_xarray(self) -> Any:
        """The trajectory as an `xarray.Dataset` with named coordinates (needs the extra
        ``xarray``).
        """
        from varint.results.save import to_xarray

        return to_xarray(self)
