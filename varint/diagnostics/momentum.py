"""Momentum maps along a trajectory: drift and slope of what symmetries conserve, and the balance
with forces.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from varint.discrete.composed import base_of
from varint.discrete.lagrangian import interval, point_function
from varint.errors import InputError
from varint.integration.step_function import along_step, over_parts
from varint.numerics.arrays import over_columns
from varint.results.dense_output import with_all_nodes
from varint.results.records import require_motion
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.system import System
from varint.symmetry.noether import symmetries
from varint.symmetry.symmetry import Symmetry

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# of its natural size: terms of J below it are small by accident, a symmetric start or a state of
# rest
LEAST = 1e-3
# of a position in one step: round-off in q comes with this part of M q/h times round-off in p
SHIFT = 1e-2
# relative drift of a quantity that the rule keeps exactly; round-off over 1e5 steps stays below
DRIFT = 1e-11


@dataclass(frozen=True, eq=False, repr=False)
class MomentumMap:
    """The quantity J of one symmetry along a trajectory.

    Attributes
    ----------
    symmetry : Symmetry
    rule : Rule
    t, values : ndarray (N + 1,)
        Times of the nodes and J there.
    expected : ndarray (N + 1,) or None
        J_0 plus what forces must have added, Σ (f⁻·ξ(q_k) + f⁺·ξ(q_{k+1})), and likewise the
        reactions λ·∂g/∂q ξ of constraints at the control points and the impulses of contacts; J_0
        where nothing breaks the symmetry; None where that is not known (a shift of time with moving
        constraints, an impact that constraints take part in).
    size : float
        Largest sum of the absolute values of J's terms; drifts are relative to it. Of a J whose
        terms are all tiny: what J would be if its coordinates took their share of the motion.
    """

    symmetry: Symmetry
    rule: Rule
    t: np.ndarray
    values: np.ndarray
    expected: np.ndarray | None
    size: float

    @property
    def change(self) -> float:
        """J_N − J_0."""
        return float(self.values[-1] - self.values[0])

    @property
    def expected_change(self) -> float | None:
        """What J_N − J_0 must be."""
        return None if self.expected is None else float(self.expected[-1] - self.expected[0])

    @property
    def error(self) -> np.ndarray:
        """(J − expected J)/size at every node, or (J − J_0)/size where nothing is known."""
        known = self.values[0] if self.expected is None else self.expected
        return (self.values - known) / self.size

    @property
    def curve(self) -> tuple[str, np.ndarray, np.ndarray]:
        """Name, times and `error`, as figures take them."""
        return self.symmetry.name, self.t, self.error

    @property
    def drift(self) -> float:
        """Largest relative deviation of J from what it must be."""
        return float(np.abs(self.error).max())

    @property
    def slope(self) -> float:
        """Slope of the relative deviation over time, by least squares."""
        if len(self.t) < 3:
            return 0.0
        t = self.t - self.t.mean()
        return float(t @ self.error / (t @ t))

    @property
    def exact(self) -> bool:
        """Whether the rule's own symmetry makes J, or its balance with forces and reactions,
        exact to round-off.
        """
        return self.symmetry.tau.is_zero() and self.symmetry.shared_by(self.rule)

    @property
    def kept(self) -> str:
        """What theory says of this rule: "exactly", "to order …", "broken by …"."""
        return self.symmetry.kept_by(self.rule)

    def __str__(self) -> str:
        name = self.symmetry.name
        if self.expected is None:
            return f"{name}: {self.kept}; J changes by {self.change:.6g}"
        if self.symmetry.conserved:
            return (
                f"{name}: J = {self.values[0]:.12g}, drift {self.drift:.1e}, slope "
                f"{self.slope:.1e}; {self.kept}"
            )
        return (
            f"{name}: {self.kept}; change of J expected {self.expected_change:.12g}, actual "
            f"{self.change:.12g} (difference {self.drift:.1e} of the terms' size)"
        )

    __repr__ = __str__

    def plot(self) -> Figure:
        """J over time, and its deviation from what it must be."""
        from varint.drawing.diagnostic_figures import momentum_maps_figure

        expected = None if self.symmetry.conserved else self.expected
        return momentum_maps_figure(str(self.rule), [self.curve], (self.values, expected))


@dataclass(frozen=True, eq=False, repr=False)
class Conserved:
    """All momentum maps of a trajectory; a table in print."""

    items: tuple[MomentumMap, ...]

    def __len__(self) -> int:
        return len(self.items)

    def __iter__(self) -> Iterator[MomentumMap]:
        return iter(self.items)

    def __getitem__(self, which: int | str) -> MomentumMap:
        if not isinstance(which, str):
            return self.items[which]
        for item in self.items:
            if item.symmetry.name == which:
                return item
        raise InputError(
            f"no symmetry is called {which!r}; there are {[m.symmetry.name for m in self.items]}"
        )

    def rows(self) -> list[tuple[str, ...]]:
        """Name, J at the start, expected and actual change, drift and slope, what the rule
        keeps.
        """
        table: list[tuple[str, ...]] = []
        for m in self.items:
            expected = "unknown" if m.expected is None else f"{m.expected_change:.6g}"
            numbers = (
                f"{m.values[0]:.9g}",
                expected,
                f"{m.change:.6g}",
                f"{m.drift:.1e}",
                f"{m.slope:.1e}",
            )
            table.append((m.symmetry.name, *numbers, m.kept))
        return table

    def __str__(self) -> str:
        head = (
            "symmetry",
            "J at start",
            "expected change",
            "actual change",
            "drift",
            "slope",
            "kept",
        )
        table = [head, *self.rows()]
        widths = [max(len(row[i]) for row in table) for i in range(len(head))]
        lines = [
            "  ".join(x.ljust(w) for x, w in zip(row, widths, strict=True)).rstrip()
            for row in table
        ]
        return "\n".join([lines[0], "  ".join("─" * w for w in widths), *lines[1:]])

    __repr__ = __str__

    def plot(self) -> Figure:
        """All quantities' deviations over time."""
        from varint.drawing.diagnostic_figures import momentum_maps_figure

        return momentum_maps_figure(
            str(self.items[0].rule) if self.items else "", [m.curve for m in self.items]
        )


def momentum_map(motion: Trajectory, symmetry: Symmetry) -> MomentumMap:
    """The quantity of `symmetry` along `motion`; see `Trajectory.momentum_map`."""
    if not isinstance(symmetry, Symmetry):
        raise InputError(
            f"momentum_map takes a Symmetry from symmetries(...) or noether(...), got {symmetry!r}"
        )
    if symmetry.system is not motion.system:
        raise InputError(
            "this symmetry is one of another system; find it with symmetries(trajectory.system)"
        )
    require_motion(motion, "their forces change momenta, and there is no balance")
    if symmetry.params is not None and not np.array_equal(symmetry.params, motion.c):
        raise InputError(
            "this symmetry holds at other parameter values only; use symmetries(system, "
            "params=trajectory.parameters)"
        )
    if motion.whole is not None:
        every, own = with_all_nodes(motion)
        along = momentum_map(every, symmetry)
        expected = None if along.expected is None else along.expected[own]
        return replace(along, t=motion.t, values=along.values[own], expected=expected)
    values, sizes = _quantity(motion, symmetry)
    size = max(float(sizes.max()), LEAST * _natural_size(motion, symmetry))
    return MomentumMap(
        symmetry, motion.rule, motion.t, values, _expected(motion, symmetry, values[0]), size or 1.0
    )


def conserved(motion: Trajectory) -> Conserved:
    """Momentum maps of all symmetries at the parameter values of `motion`; see
    `Trajectory.conserved`.
    """
    s = motion.system
    arguments: dict[str, Any] = {"params": motion.parameters}
    try:
        found = symmetries(s, motion.rule, **arguments)
    except InputError:  # not defined near the origin: look around the motion
        found = symmetries(s, motion.rule, near=motion.q[len(motion) // 2], **arguments)
    return Conserved(tuple(momentum_map(motion, symmetry) for symmetry in found))


def _quantity(motion: Trajectory, symmetry: Symmetry) -> tuple[np.ndarray, np.ndarray]:
    """J and the size of its terms at every node, from the momenta themselves rather than through
    velocities.
    """
    s = symmetry.system
    p = ca.SX.sym("p", s.structure.n)
    terms = [p * symmetry.xi, -symmetry.gauge]
    if not symmetry.tau.is_zero():
        terms += [symmetry.tau * p * s.v, -symmetry.tau * s.lagrangian]
    parts = ca.densify(ca.vertcat(*terms))
    f = ca.Function(
        "quantity",
        [s.q, p, s.v, s.t, s.c],
        [ca.sum1(parts), ca.sum1(ca.fabs(parts))],
        {"cse": True},
    )
    v = motion.p if symmetry.tau.is_zero() else motion.v
    values, sizes = over_columns(f, motion.q, motion.p, v, motion.t[:, None], motion.c)
    return values[:, 0], sizes[:, 0]


def _natural_size(motion: Trajectory, symmetry: Symmetry) -> float:
    """Size of p·ξ if every coordinate had the largest √M q and p/√M of all: where J is zero, its
    round-off is not.

    Momenta are taken no smaller than those that shift a position by 1 % of itself in a step:
    resting scenes have none.
    """
    s, n = symmetry.system, symmetry.system.structure.n
    mass = ca.Function("mass", [s.q, s.v, s.t, s.c], [ca.densify(ca.fabs(ca.diag(s.mass_matrix)))])
    inertia = over_columns(mass, motion.q, motion.v, motion.t[:, None], motion.c)[0].max(axis=0)
    root = np.sqrt(np.where(inertia > 0, inertia, inertia.max() or 1.0))
    q = np.abs(motion.q * root).max() / root
    p = max(np.abs(motion.p / root).max(), SHIFT * (root * q).max() / abs(motion.h)) * root
    slope = ca.jacobian(symmetry.xi, s.q)
    field = ca.Function("field", [s.q, s.t, s.c], [ca.densify(symmetry.xi), ca.densify(slope)])
    xi, slope = over_columns(field, motion.q, motion.t[:, None], motion.c)
    turn = np.abs(slope).max(axis=0).reshape(n, n).T @ q
    return float(p @ np.maximum(np.abs(xi).max(axis=0), turn))


def _expected(motion: Trajectory, symmetry: Symmetry, start: float) -> np.ndarray | None:
    if not symmetry.broken_by:
        return np.full(len(motion), start)
    jumps = _jumps(motion, symmetry)
    if jumps is None or (
        not symmetry.tau.is_zero() and {"constraint", "nonholonomic"} & set(symmetry.broken_by)
    ):
        return None
    work = motion.sums(lambda scene: _work(scene, motion.rule, symmetry))[:, 0]
    return start + np.concatenate([[0.0], np.cumsum(work)]) + np.cumsum(jumps)


def _jumps(motion: Trajectory, symmetry: Symmetry) -> np.ndarray | None:
    """What impacts add to J at each node, Λ ∂gap/∂q·ξ; None where other rows take part in one,
    unknown by how much.
    """
    s, jumps = symmetry.system, np.zeros(len(motion))
    gaps = ca.Function(
        "gaps", [s.q, s.t, s.c], [ca.mtimes(ca.jacobian(s.contact, s.q), symmetry.xi)]
    )
    for event in motion.events:
        if event.contact is None or not event.impulse:
            continue
        passed = (event.time - motion.t) * motion.h
        if passed[0] <= 0 or passed[-1] > 0:
            continue
        # of two at the same time the one after it
        node = len(motion) - 1 - int(np.argmin(np.abs(passed[::-1])))
        held = (
            motion.active_sets[motion.active_set[max(node - 1, 0)]]
            if motion.active_set is not None
            else None
        )
        others = (
            s.structure.nonholonomic
            or s.structure.constraints
            or (held is not None and held.holding)
        )
        if others or motion.t[node] != event.time:
            return None
        if symmetry.tau.is_zero():
            along = np.array(gaps(motion.q[node], motion.t[node], motion.c)).ravel()[event.contact]
            jumps[node] += event.impulse * along
        else:
            jumps[node] += event.energy_after - event.energy_before
    return jumps


def _work(system: System, rule: Rule, symmetry: Symmetry) -> ca.Function:
    """What forces and reactions r_j add to J in a step, Σ_j (f_j + r_j)·ξ(Q_j).

    The forces' part is h Σ_i b_i F_i·ξ(q(c_i h)) for affine ξ. Eliminating the inner control points
    turns the sum over j into f⁻·ξ(q_k) + f⁺·ξ(q_{k+1}).
    """
    if base := base_of(system, rule):
        return over_parts(system, rule, _work(system, base, symmetry))
    one, s = interval(system, rule), system
    along = ca.Function(
        "along", [s.q, s.v, s.t, s.c], [ca.densify(symmetry.xi + symmetry.tau * s.v)]
    )
    along_xi = ca.Function("xi", [s.q, s.t, s.c], [ca.densify(symmetry.xi)])
    work = ca.SX(0)
    for i, b in enumerate(rule.weights):
        q, v, t = one.q_nodes[:, i], one.v_nodes[:, i], one.t_nodes[i]
        force = point_function(s)(q, v, one.u[:, i], t, one.c)[3]
        work += one.h * b * ca.dot(force, along(q, v, t, one.c))
    reactions = ca.SX.sym("reactions", s.structure.n, one.dq.shape[1] + 1)
    if rule.points and not symmetry.xi.is_zero():
        path = ca.horzcat(one.q0, ca.repmat(one.q0, 1, one.dq.shape[1]) + one.dq)
        for j, point in enumerate(rule.points):
            work += ca.dot(reactions[:, j], along_xi(path[:, j], one.t + one.h * point, one.c))
    return along_step(system, rule, one, [work], reactions)
