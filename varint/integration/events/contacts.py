"""What contacts look like, at an instant and a sub-step later: each in one call of one function."""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from varint.discrete.constraints import ActiveSet, every_row_function, multiplier_function
from varint.discrete.legendre import velocity_function
from varint.integration.plan import plan
from varint.integration.steppers.stepper import state_layout, state_parts
from varint.numerics.arrays import call, over_columns
from varint.rules.rule import Rule
from varint.scene.memory import per_system
from varint.scene.system import System

NEAR = 1e-3  # of the largest coordinate: what the others count at least in the size of a gap


@dataclass(frozen=True, eq=False)
class Instant:
    """One instant of the motion: t, the state x = [q, p] with the compensation of each sum after
    it, and the active set of contacts.
    """

    t: float
    x: np.ndarray
    active_set: ActiveSet

    @property
    def q(self) -> np.ndarray:
        return self.x[: len(self.x) // 4]

    @property
    def p(self) -> np.ndarray:
        return self.x[state_layout(len(self.x) // 4).p]

    @property
    def carry(self) -> np.ndarray:
        """The compensation of p."""
        return self.x[state_layout(len(self.x) // 4).p_rest]

    def pushed(self, impulse: np.ndarray, rest: np.ndarray) -> Instant:
        """The instant with p + impulse; the round-off of the sum goes to its compensation, and
        so does `rest`.
        """
        x, layout = self.x.copy(), state_layout(len(self.x) // 4)
        p = self.p + impulse
        part = p - self.p
        x[layout.p] = p
        x[layout.p_rest] += ((self.p - (p - part)) + (impulse - part)) + rest
        return replace(self, x=x)


@dataclass(frozen=True, eq=False)
class View:
    """The contact problem at one instant: v (n,), gaps g and rates ġ (m,), gradients ∂/∂q of all
    constraint and contact rows (rows, n), mass matrix (n, n), energy.
    """

    v: np.ndarray
    gap: np.ndarray
    rate: np.ndarray
    slope: np.ndarray
    mass: np.ndarray
    energy: float

    def sizes(self, q: np.ndarray, reach: np.ndarray) -> np.ndarray:
        """What a change of each coordinate by its own size, or by its `reach` in a step, would
        make of each gap.
        """
        far = max(np.abs(q).max(initial=0.0), reach.max(initial=0.0))
        return np.abs(self.closing) @ np.maximum(np.maximum(np.abs(q), NEAR * far), reach)

    def speeds(self, typical: np.ndarray) -> np.ndarray:
        """What the velocities contribute to each gap's rate, without regard to sign; at least what
        a part of the largest of the `typical` ones would: what rests beside moving bodies has
        their round-off.
        """
        closing, sizes = self.closing, np.abs(self.closing)
        own = sizes @ np.abs(self.v) + np.abs(self.rate - closing @ self.v)
        return np.maximum(own, NEAR * typical.max(initial=0.0) * sizes.sum(axis=1))

    @property
    def closing(self) -> np.ndarray:
        """∂gap/∂q of the contacts."""
        return self.slope[len(self.slope) - len(self.gap) :]


@per_system
def first_contact(system: System) -> int:
    """How many rows come before those of the contacts: holonomic and non-holonomic ones."""
    return system.constraint.numel() + system.nonholonomic.shape[0]


@per_system
def rates_function(system: System, rows: tuple[int, ...], contacts: tuple[int, ...]) -> ca.Function:
    """(q, p, t, c) → (v, gaps, their rates) in an active set."""
    s = system
    rate = ca.jtimes(s.contact, s.q, s.v) + ca.jacobian(s.contact, s.t)
    gaps = ca.Function(
        "gaps", [s.q, s.v, s.t, s.c], [ca.densify(s.contact), ca.densify(rate)], {"cse": True}
    )
    q, p, t, c = (
        ca.MX.sym(name, x.numel()) for name, x in zip("qptc", (s.q, s.q, s.t, s.c), strict=True)
    )
    v = velocity_function(ActiveSet(rows, contacts, contacts).scene(s))(q, p, t, c)
    return ca.Function("rates", [q, p, t, c], [ca.densify(x) for x in (v, *gaps(q, v, t, c))])


@per_system
def _force_function(
    system: System, rows: tuple[int, ...], contacts: tuple[int, ...]
) -> ca.Function:
    """(q, v, u, t, c) → the largest of the forces M dv/dt in an active set."""
    s = system
    mass = ca.Function("mass", [s.q, s.v, s.t, s.c], [ca.densify(s.mass_matrix)])
    sizes = (s.q.numel(), s.q.numel(), s.control.numel(), 1, s.c.numel())
    q, v, u, t, c = (ca.MX.sym(name, k) for name, k in zip("qvutc", sizes, strict=True))
    a = multiplier_function(ActiveSet(rows, contacts, contacts).scene(s))(q, v, u, t, c)[1]
    return ca.Function("force", [q, v, u, t, c], [ca.norm_inf(ca.mtimes(mass(q, v, t, c), a))])


def least_pull(system: System, active_set: ActiveSet, q, v, u, t, c) -> np.ndarray:
    """Multipliers that are nothing beside the forces that move other bodies, at many nodes."""
    function = _force_function(system, active_set.rows, active_set.contacts)
    return NEAR * over_columns(function, q, v, u, t[:, None], c)[0][:, 0]


@per_system
def view_function(system: System, rows: tuple[int, ...], contacts: tuple[int, ...]) -> ca.Function:
    """(q, p, t, c) → everything of a `View`, one after the other."""
    s = system
    others = ca.Function(
        "others", [s.q, s.v, s.t, s.c], [ca.vertcat(ca.vec(s.mass_matrix), s.energy)]
    )
    q, p, t, c = (
        ca.MX.sym(name, x.numel()) for name, x in zip("qptc", (s.q, s.q, s.t, s.c), strict=True)
    )
    v, gap, rate = rates_function(s, rows, contacts)(q, p, t, c)
    slope = every_row_function(s)(q, v, t, c)[1]
    seen = ca.vertcat(v, gap, rate, ca.vec(slope), others(q, v, t, c))
    return ca.Function("view", [q, p, t, c], [ca.densify(seen)])


@per_system
def passage_function(
    system: System, rule: Rule, rows: tuple[int, ...], contacts: tuple[int, ...]
) -> ca.Function:
    """(x, scale, u, c, (t, h)) → x, residual, iterations and `View` after a step of any size h
    in an active set.
    """
    scene = ActiveSet(rows, contacts, contacts).scene(system)
    stepper, n = plan(scene, rule).build(scene, rule), system.q.numel()
    x, scale, u = (
        ca.MX.sym("x", 4 * n),
        ca.MX.sym("scale", 2 * n),
        ca.MX.sym("u", stepper.step.numel_in(1)),
    )
    c, clock = ca.MX.sym("c", system.c.numel()), ca.MX.sym("clock", 2)
    q, _, p, _ = ca.vertsplit(x, n)
    t, h = clock[0], clock[1]
    begin = stepper.start(q, p, u, t, h, c)
    after = stepper.step(ca.vertcat(x, begin[4 * n :]), u, t, h, c, scale)
    moved = state_parts(after, n)
    seen = view_function(system, rows, contacts)(moved.q, moved.p, t + h, c)
    flat = ca.vertcat(after[state_layout(n).moving], moved.residual, moved.iterations, seen)
    return ca.Function("passage", [x, scale, u, c, clock], [ca.densify(flat)])


def view(system: System, now: Instant, c: np.ndarray) -> View:
    """Everything about the contacts at an instant."""
    function = view_function(system, now.active_set.rows, now.active_set.contacts)
    return split(
        call(function, now.q, now.p, np.array([now.t]), c)[0], len(now.q), system.contact.numel()
    )


def split(flat: np.ndarray, n: int, contacts: int) -> View:
    """The parts of a view."""
    gap, rate, slope = n, n + contacts, n + 2 * contacts
    mass = len(flat) - 1 - n * n
    return View(
        flat[:n],
        flat[gap:rate],
        flat[rate:slope],
        flat[slope:mass].reshape(n, -1).T,
        flat[mass : mass + n * n].reshape(n, n).T,
        float(flat[-1]),
    )
