"""The scene: symbols, Lagrangian, forces and constraints as CasADi expressions."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.scene.alike import first_alike
from varint.scene.parameters import (
    Parameters,
    ParameterValues,
    parameter_array,
    parameters_of,
    values_by_name,
)
from varint.scene.rays import Rays, checked_rays
from varint.scene.restitution import bounce_of, restitution_at
from varint.scene.structure import Structure, structure_of
from varint.scene.validation import (
    check_symbols,
    expression,
    pfaffian,
    rows,
    symbols,
)

if TYPE_CHECKING:
    from varint.scene.kinetics import Kinetics
    from varint.typeset.equations import Equations


def coordinates(*names: str) -> tuple[ca.SX, ca.SX]:
    """Symbols q and v = dq/dt of a scene, one of each per name.

    Parameters
    ----------
    *names : str
        One name a coordinate; the velocity of ``x`` is called ``x_dot``.

    Returns
    -------
    q, v : SX (n,)
        Column vectors of symbols.

    Raises
    ------
    InputError
        If no name is given, one is empty, repeated or no string, or the only one has several words.

    Examples
    --------
    >>> import varint as vi
    >>> q, v = vi.coordinates("r", "theta")
    >>> q, v
    (SX([r, theta]), SX([r_dot, theta_dot]))
    """
    if not names:
        raise InputError('coordinates() was given no name; write for example coordinates("theta")')
    for name in names:
        if not isinstance(name, str) or not name:
            raise InputError(f"coordinate names are non-empty strings, got {name!r}")
    if len(names) == 1 and len(several := re.split(r"[\s,]+", names[0].strip())) > 1:
        raise InputError(
            f"{names[0]!r} names one coordinate; write coordinates{tuple(several)!r} for "
            f"{len(several)} of them, or a name without spaces and commas"
        )
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(
            f"coordinate names {twice} are given more than once; each names one coordinate"
        )
    return (
        ca.vertcat(*(ca.SX.sym(name) for name in names)),
        ca.vertcat(*(ca.SX.sym(f"{name}_dot") for name in names)),
    )


def time() -> ca.SX:
    """The symbol t of an explicitly time-dependent scene; hand it to `System` as ``t=``."""
    return ca.SX.sym("t")


def parameter_values(system: System, overrides: ParameterValues | None) -> np.ndarray:
    """The vector of parameter values of one run: the defaults with `overrides` put in, in the
    order of `system.c`.
    """
    if overrides is None:
        return system.default_vector
    given = given_parameters(system, overrides)
    if not given:
        return system.default_vector
    values, first = system.default_vector.copy(), 0
    for name, default in system.defaults.items():
        last = first + default.size
        if name in given:
            value = parameter_array(name, given[name], default.shape, "default")
            values[first:last] = value.ravel(order="F")
        first = last
    return values


def parameters_by_name(system: System, c: np.ndarray) -> dict[str, np.ndarray]:
    """The vector of parameter values as arrays by name."""
    values, first = {}, 0
    for name, default in system.defaults.items():
        values[name] = c[first : first + default.size].reshape(default.shape, order="F")
        first += default.size
    return values


def parameter_entries(system: System) -> list[str]:
    """A name for every entry of the vector of parameters: ``g``, ``mass[0]``, ``mass[1]``."""
    at = parameters_by_name(system, np.arange(system.c.numel()))
    named = {
        int(places[index]): f"{name}[{', '.join(map(str, index))}]" if index else name
        for name, places in at.items()
        for index in np.ndindex(places.shape)
    }
    return [named[i] for i in range(len(named))]


def given_parameters(system: System, params: ParameterValues | None) -> dict[str, Any]:
    """What a user gives for parameters of the system, by name."""
    given = {} if params is None else values_by_name(params)
    if unknown := [name for name in given if name not in system.defaults]:
        raise InputError(f"unknown parameters {unknown}; known: {list(system.defaults)}")
    return given


@dataclass(frozen=True, eq=False, repr=False)
class System:
    """A mechanical scene by the principle of least action: δ∫ (L + λ·g) dt + ∫ F·δq dt = 0.

    Its equations of motion are ``d/dt ∂L/∂v − ∂L/∂q = Gᵀλ + F`` with ``G = ∂g/∂q``.

    Parameters
    ----------
    q, v : SX (n,)
        Coordinates and velocities, from `coordinates`.
    lagrangian : SX
        L(q, v, t), a scalar, in any consistent units.
    constraint : SX (m,), optional
        Holonomic constraints g(q, t) = 0.
    nonholonomic : SX (k, n), optional
        Rows A(q) of the velocity constraints A(q) v = 0.
    contact : SX (c,), optional
        Gaps of unilateral, frictionless contacts, gap(q, t) ≥ 0; they need a Lobatto rule
        (`trapezoidal`, `lobatto`) and a Lagrangian quadratic in the velocities.
    restitution : float, SX, or sequence of c of them, optional
        Coefficients of restitution of the contacts, between 0 and 1 (default 0: no bounce), numbers
        or expressions of the parameters, ``restitution=c.e``. A contact at rest under a blow
        elsewhere stays closed if its own is 0, and hands the blow on otherwise (Newton's cradle).
    force : SX (n,), optional
        Generalised force F(q, v, u, t) (Lagrange–d'Alembert). One that is written as zero is none.
    control : SX (k,), optional
        Control symbols u; they act through `force`. In optimal control one that stands in the cost
        or in bounds only is a slack.
    params : Parameters or dict, optional
        Named constants: `Parameters`, or your own symbols with their default values, ``{m: 1.0}``
        with ``m = ca.SX.sym("m")``. CasADi takes no vectors as keys; give those as a list of
        pairs, ``[(m, 1.0), (a, [1, 2, 3])]``.
    t : SX, optional
        The time symbol from `time`, where the scene depends on time.
    kinetics : Kinetics, optional
        What the scene knows of its Lagrangian besides the expression: a mass matrix, an inverse
        Legendre transform and derivatives that cost less than those derived from it.
        `varint.multibody` gives them.
    rays : sequence of sequences of int, optional
        Groups of coordinates of which only the ratio matters, as unit quaternions: L is unchanged
        by q → λ q, v → λ v in each, and gives the length inertia, as (q·v)²/(q·q)²/2 does, which is
        zero along the motion. No constraint holds their length; motions have unit vectors at their
        nodes. `varint.multibody` gives them.

    Raises
    ------
    InputError
        If an expression has undeclared symbols or the wrong shape, or L has no velocities.

    Examples
    --------
    >>> import casadi as ca
    >>> import varint as vi
    >>> q, v = vi.coordinates("theta")
    >>> pendulum = vi.System(q, v, v**2 / 2 + 9.81 * ca.cos(q))
    >>> pendulum.structure.separable, pendulum.momentum
    (True, SX(theta_dot))
    >>> m, k = ca.SX.sym("m"), ca.SX.sym("k")
    >>> spring = vi.System(q, v, m * v**2 / 2 - k * q**2 / 2, params={m: 1.0, k: 4.0})
    >>> vi.simulate(spring, q0=1, v0=0, h=0.1, steps=10, params={k: 2.0}).parameters["k"]
    array(2.)
    """

    q: ca.SX
    v: ca.SX
    lagrangian: ca.SX
    constraint: Any = None
    nonholonomic: Any = None
    contact: Any = None
    restitution: Any = 0.0
    force: Any = None
    control: Any = None
    params: Parameters | None = None
    t: Any = None
    kinetics: Kinetics | None = None
    rays: Rays = ()
    bounce: ca.SX = field(init=False)  # restitution as expressions of the parameters

    def __init__(
        self,
        q: ca.SX,
        v: ca.SX,
        lagrangian: ca.SX,
        *,
        constraint: ca.SX | None = None,
        nonholonomic: ca.SX | None = None,
        contact: ca.SX | None = None,
        restitution: Any = 0.0,
        force: ca.SX | None = None,
        control: ca.SX | None = None,
        params: Parameters | ParameterValues | None = None,
        t: ca.SX | None = None,
        kinetics: Kinetics | None = None,
        rays: Sequence[Sequence[int]] = (),
    ):
        q, v = symbols("q", q), symbols("v", v)
        n = q.numel()
        if n == 0 or v.numel() != n:
            raise InputError(
                f"q has {n} and v has {v.numel()} components; take both from coordinates(...)"
            )
        if all(q[i].name() == f"{v[i].name()}_dot" for i in range(n)):
            raise InputError(
                "q and v have changed places: coordinates(...) returns q first, and v, whose names "
                f"end in _dot; got q={q}"
            )
        t = ca.SX.sym("t") if t is None else symbols("t", t)
        if t.numel() != 1:
            raise InputError(f"t has {t.numel()} components; take it from time()")
        u = ca.SX(0, 1) if control is None else symbols("control", control)
        values = dict(
            q=q,
            v=v,
            t=t,
            control=u,
            kinetics=kinetics,
            params=None if params is None else parameters_of(params),
            lagrangian=expression("the Lagrangian", lagrangian, (1, 1)),
            force=_without_zeros(
                expression("the force", ca.SX(n, 1) if force is None else force, (n, 1))
            ),
            constraint=rows("the constraint", constraint),
            nonholonomic=pfaffian(nonholonomic, v),
            contact=rows("the contact", contact),
        )
        for name, value in values.items():
            object.__setattr__(self, name, value)
        parts = {
            "the Lagrangian": self.lagrangian,
            "the force": self.force,
            "the constraint": self.constraint,
            "nonholonomic": ca.vec(self.nonholonomic),
            "the contact": self.contact,
        }
        check_symbols(self.q, self.v, self.t, self.control, self.c, parts)
        object.__setattr__(self, "bounce", bounce_of(restitution, self.contact.numel(), self.c))
        object.__setattr__(self, "restitution", restitution_at(self, self.default_vector))
        object.__setattr__(self, "rays", checked_rays(rays, self))
        if kinetics is not None:
            from varint.scene.kinetics import check_kinetics  # of machines alone

            check_kinetics(self)

    def __repr__(self) -> str:
        parts = [f"q=[{', '.join(self.names)}]"]
        parts += [
            f"{what}={count}"
            for what in ("controls", "constraints", "nonholonomic", "contacts")
            if (count := getattr(self.structure, what))
        ]
        if self.defaults:
            parts.append(f"params={list(self.defaults)}")
        return f"System({', '.join(parts)})"

    def _repr_latex_(self) -> str | None:
        """For notebooks: the Lagrangian, where SymPy is installed and it is not too long."""
        from varint.scene.letters import lagrangian_latex

        return lagrangian_latex(self)

    def __reduce__(self) -> tuple[Callable[[str], System], tuple[str]]:
        """To another process it travels as plain data: names, numbers and elementary operations."""
        import json

        from varint.scene.description import description  # few scenes travel

        return _system_of, (json.dumps(description(self)),)

    def __copy__(self) -> System:
        """Itself: nothing in it changes."""
        return self

    def __deepcopy__(self, memo: Any) -> System:
        """Itself, so that expressions of its symbols stay expressions of the copy's."""
        return self

    @cached_property
    def structure(self) -> Structure:
        """What the scene has and lacks."""
        if (first := first_alike(self)) is not self:
            return first.structure
        return structure_of(
            self.q,
            self.v,
            self.t,
            self.control,
            self.lagrangian,
            self.force,
            self.constraint,
            self.nonholonomic,
            self.contact,
        )

    @cached_property
    def momentum(self) -> ca.SX:
        """Canonical momentum p = ∂L/∂v, (n,)."""
        return ca.gradient(self.lagrangian, self.v)

    @cached_property
    def generalised_force(self) -> ca.SX:
        """Rate of the momentum ∂L/∂q + F, without reactions, (n,)."""
        return ca.gradient(self.lagrangian, self.q) + self.force

    @cached_property
    def energy(self) -> ca.SX:
        """Energy H = v·∂L/∂v − L as an expression of q, v, t."""
        return ca.dot(self.v, self.momentum) - self.lagrangian

    @property
    def equations(self) -> Equations:
        """Euler–Lagrange equations, momenta, energy … to be read, by `varint.equations`."""
        from varint.typeset.equations import equations

        return equations(self)

    @cached_property
    def mass_matrix(self) -> ca.SX:
        """Mass matrix M = ∂²L/∂v², (n, n)."""
        if self.kinetics is not None:
            return self.kinetics.mass_matrix
        found = ca.jacobian(self.momentum, self.v)
        if found.sparsity().is_symmetric():
            return found
        # SX sees of some entry that it is zero, but not of its mirror image
        return ca.project(found, found.sparsity().intersect(found.T.sparsity()))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        return tuple(s.name() for s in ca.symvar(self.q))

    @cached_property
    def control_names(self) -> tuple[str, ...]:
        """Names of the controls."""
        return tuple(s.name() for s in ca.symvar(self.control)) if self.control.numel() else ()

    @cached_property
    def c(self) -> ca.SX:
        """All parameters as one column vector of symbols."""
        symbols = self.params._symbols.values() if self.params is not None else ()
        return ca.vertcat(ca.SX(0, 1), *(ca.vec(s) for s in symbols))

    @property
    def defaults(self) -> dict[str, np.ndarray]:
        """Default values of the parameters by name."""
        return self.params._defaults if self.params is not None else {}

    @cached_property
    def default_vector(self) -> np.ndarray:
        """Default values of the parameters, in the order of `c`."""
        return np.concatenate([np.zeros(0), *(v.ravel(order="F") for v in self.defaults.values())])


def _without_zeros(force: ca.SX) -> ca.SX:
    """No force where every entry of it is zero for any motion, as of a drag with c = 0."""
    return ca.SX(*force.shape) if force.is_zero() else force


def _system_of(text: str) -> System:
    import json

    from varint.scene.description import parts_of

    return System(**parts_of(json.loads(text)))


def require_system(x: Any) -> None:
    """Refuse what is no system where one is expected."""
    if not isinstance(x, System):
        held = getattr(x, "system", None)  # of a model or a motion; a machine makes one
        way = "; give its .system" if held else ""
        way += "()" if callable(held) else ""
        raise InputError(f"the first argument must be a varint System, got {type(x).__name__}{way}")
