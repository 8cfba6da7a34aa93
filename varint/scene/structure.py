"""What a scene has and what it lacks, found exactly by dependence and sparsity.

Every answer follows from the expression graph (`depends_on`, Hessian sparsity), never from samples:
an expression that cancels only numerically counts as present, so a "no" costs time but never
correctness.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import casadi as ca

from varint.numerics.operations import ZERO, has_step, operations_of


@dataclass(frozen=True)
class Structure:
    """What a system has and lacks; see `structure_of`."""

    n: int
    controls: int
    constraints: int
    nonholonomic: int
    contacts: int
    separable: bool
    constant_mass: bool
    diagonal_mass: bool
    quadratic_kinetic: bool
    degenerate: bool
    linear: bool
    autonomous: bool
    forced: bool
    force_on_velocity: bool
    cyclic: tuple[int, ...]
    blocks: tuple[tuple[int, ...], ...]

    @property
    def explicit(self) -> bool:
        """L = ½ vᵀMv − V(q, t) with constant M, forces free of v, nothing else: kick and drift
        suffice.
        """
        extra = self.constraints or self.nonholonomic or self.contacts
        return (
            self.separable
            and self.constant_mass
            and not self.degenerate
            and not self.force_on_velocity
            and not extra
        )

    @property
    def velocity_rows(self) -> int:
        """Number of rows W v + w = 0 that restrict velocities, holonomic and non-holonomic."""
        return self.constraints + self.nonholonomic

    def __str__(self) -> str:
        return "\n".join(f"{f.name:>18}: {getattr(self, f.name)}" for f in fields(self))


def structure_of(q, v, t, u, lagrangian, force, constraint, nonholonomic, contact) -> Structure:
    """Structure of the scene with Lagrangian L(q, v, t), force F(q, v, u, t) and constraints g(q,
    t).

    Parameters
    ----------
    q, v, t, u : SX
        The symbols.
    lagrangian, force, constraint, nonholonomic, contact : SX
        Expressions; empty where the scene has none.

    Returns
    -------
    Structure
    """
    n = q.numel()
    state, gradient = ca.vertcat(q, v), ca.gradient(lagrangian, ca.vertcat(q, v))
    hessian = slope_sparsity(gradient, state)
    lower = ca.DM(hessian, 1)[n:, :]
    mixed, mass = lower[:, :n].sparsity(), lower[:, n:].sparsity()
    momentum = gradient[n:]
    # derivatives in a direction of symbols depend on what those in any direction depend on, and
    # are no longer than what they are taken of
    along = ca.SX.sym("along", n)
    mass_along = ca.jtimes(momentum, v, along)
    pushed = ca.vertcat(state, u)
    slopes = [
        ca.jtimes(gradient, state, ca.SX.sym("along", 2 * n)),
        ca.jtimes(force, pushed, ca.SX.sym("along", pushed.numel())),
    ]
    held = ca.vertcat(constraint, contact, ca.vec(nonholonomic))
    depends = ca.which_depends(lagrangian, q, 1, False)
    return Structure(
        n=n,
        controls=u.numel(),
        constraints=constraint.numel(),
        nonholonomic=nonholonomic.shape[0],
        contacts=contact.numel(),
        separable=mixed.nnz() == 0 and not ca.depends_on(momentum, ca.vertcat(q, t)),
        constant_mass=not ca.depends_on(mass_along, ca.vertcat(state, t)),
        diagonal_mass=mass.is_diag(),
        quadratic_kinetic=not (ca.depends_on(mass_along, v) or jumps(momentum, v)),
        degenerate=mass.nnz() == 0,
        linear=not any(ca.depends_on(s, ca.vertcat(state, t, u)) for s in slopes)
        and held.numel() == 0
        and not jumps(ca.vertcat(gradient, force), ca.vertcat(state, u)),
        autonomous=not any(ca.depends_on(e, t) for e in (lagrangian, force, held)),
        forced=force.nnz() > 0,
        force_on_velocity=ca.depends_on(force, v),
        cyclic=tuple(i for i, there in enumerate(depends) if not there),
        blocks=_blocks(n, hessian, slope_sparsity(force, state), slope_sparsity(held, state)),
    )


def slope_sparsity(expression: ca.SX, x: ca.SX) -> ca.Sparsity:
    """Where ∂expression/∂x may be different from zero, without building it."""
    others = ca.vertcat(*(y for y in ca.symvar(expression) if not ca.depends_on(x, y)))
    f = ca.Function("f", [x, others], [ca.densify(expression)])
    return f.jac_sparsity(0, 0)


def jumps(expression: ca.SX, x: ca.SX) -> bool:
    r"""Whether something in the expression has a step or a kink in x, of which derivatives say
    nothing: that of sign(x) is zero, that of \|x\| is constant.
    """
    others = ca.vertcat(*(y for y in ca.symvar(expression) if not ca.depends_on(x, y)))
    operations = operations_of(ca.Function("f", [x, others], [ca.densify(expression)])).nodes
    depends: list[bool] = []
    for name, *taken in operations:
        if name in ("const", "input"):
            depends.append(name == "input" and taken[0] == 0)
            continue
        on_x = [depends[i] for i in taken]
        inner = (ZERO if operations[i] == ("const", 0.0) else operations[i][0] for i in taken)
        if any(on_x[:1] if name == "if_else_zero" else on_x) and has_step(name, *inner):
            return True
        depends.append(any(on_x))
    return False


def _blocks(n: int, hessian, force_slope, held_slope) -> tuple[tuple[int, ...], ...]:
    """Groups of coordinates that no derivative couples: connected components of the sparsity
    graph.
    """
    group = list(range(n))

    def root(i: int) -> int:
        while group[i] != i:
            i = group[i] = group[group[i]]
        return i

    def join(pattern, offset_rows: bool) -> None:
        rows, cols = pattern.get_triplet()
        first: dict[int, int] = {}
        for r, c in zip(rows, cols, strict=True):
            i = r % n if offset_rows else first.setdefault(r, c % n)
            group[root(i)] = root(c % n)

    join(hessian, True)
    join(force_slope, True)
    join(held_slope, False)
    members: dict[int, list[int]] = {}
    for i in range(n):
        members.setdefault(root(i), []).append(i)
    return tuple(tuple(m) for m in members.values())
