"""One instant of a motion, and something that happened between its nodes."""

from __future__ import annotations

from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from varint.errors import InputError, parsed_or_refused
from varint.scene.rays import make_nodes_unit

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    import casadi as ca

    from varint.scene.system import System


class OnDemand:
    """A field of this name of a dataclass with a default; but where an instance has a function
    `_make` in its `__dict__`, what that makes of the name, at the first look.
    """

    def __init__(self, name: str, default: Any) -> None:
        self.name, self.default = name, default

    def __get__(self, instance: Any, owner: type | None = None) -> Any:
        make = None if instance is None else instance.__dict__.get("_make")
        if make is None:
            return self.default
        return instance.__dict__.setdefault(self.name, make(self.name))


EVENTS: Any = OnDemand("events", ())
FICTITIOUS: Any = OnDemand("fictitious", None)


def made_at_first_look(instance: Any, name: str) -> Any:
    """`__getattr__` of a dataclass: fields without a default that an instance leaves to a function
    `_make` in its `__dict__`.
    """
    own = instance.__dict__
    if name in instance.__dataclass_fields__ and "_make" in own:
        return own.setdefault(name, own["_make"](name))
    return object.__getattribute__(instance, name)  # or the error that led here


def changed(motion: Any, **changes: Any) -> Any:
    """`replace` of a trajectory in a quarter of the time."""
    own = motion.__dict__
    names = motion.__dataclass_fields__
    made = "_make" in own  # some of them are made at the first look, of which nodes are other ones
    later = made and "t" in changes and "k" in changes
    if made and not later:
        for name in names:
            if name not in changes:
                getattr(motion, name)
    other = object.__new__(type(motion))
    kept = {name: own[name] for name in names if name in own}
    if later:
        kept["_make"] = own["_make"]
    other.__dict__.update(kept, **changes)
    if motion.system.rays:
        make_nodes_unit(other)
    return other


def leans(motion: Any) -> bool:
    """Whether it is a path of least action that leans on its bounds: there it is no motion, and
    steps from its nodes lead elsewhere.
    """
    return bool(np.any(getattr(motion.solution, "touches", False)))


OWN_ACTION = "own_action"


def with_own_action(motion: Any, action: float | None) -> Any:
    """The motion with the action that was found with it, which goes into copies and files, but not
    to parts of it; with none as it is.
    """
    if action is not None:
        motion.__dict__.update({"action": action, OWN_ACTION: action})
    return motion


def own_action(motion: Any) -> float | None:
    """The action that was found with a motion, of a path as a whole; None where it is a sum over
    its steps.
    """
    return motion.__dict__.get(OWN_ACTION)


def state_of(motion: Any) -> dict[str, Any]:
    """What of a trajectory goes into a copy, plain enough to be pickled."""
    state = {f.name: getattr(motion, f.name) for f in fields(motion)}
    return state | {"stats": dict(motion.stats), OWN_ACTION: own_action(motion)}


def arrive(motion: Any, state: dict[str, Any]) -> None:
    """Fill a copy with what `state_of` made."""
    fields_of = {name: x for name, x in state.items() if name != OWN_ACTION}
    motion.__dict__.update(fields_of, stats=MappingProxyType(state["stats"]))
    with_own_action(motion, state.get(OWN_ACTION))


def checked_index(index: Any, count: int) -> Any:
    """What `trajectory[index]` takes beside names: the number of a node, a slice, or a list of
    numbers or truth values, of which arrays are made.
    """
    if isinstance(index, (int, np.integer)):
        return index
    if isinstance(index, slice):
        parsed_or_refused(lambda: index.indices(count), lambda: _no_index(index, count))
        return index
    if isinstance(index, (list, np.ndarray)):
        chosen = parsed_or_refused(
            lambda: np.array(index, ndmin=1), lambda: _no_index(index, count)
        )
        if not len(chosen):
            return chosen.astype(int)
        kind, flat = chosen.dtype.kind, chosen.ndim == 1
        if flat and kind == "b" and len(chosen) == count:
            return chosen
        if flat and kind in "iu" and -count <= chosen.min() and chosen.max() < count:
            return chosen
    raise InputError(_no_index(index, count))


def _no_index(index: Any, count: int) -> str:
    return (
        f"trajectory[{index!r}]: write the number of a node, a slice, a list of numbers of the "
        f"{count} nodes, or a name"
    )


def require_motion(motion: Any, why: str) -> None:
    """Refuse a path that leans on its bounds, and say why."""
    if leans(motion):
        raise InputError(f"the path leans on its bounds: {why}")


def require_order(motion: Any) -> None:
    """Refuse nodes that do not follow each other as the motion went."""
    if (np.diff(motion.t) * motion.h < 0).any():
        raise InputError(
            "the action and other sums are over steps from node to node, but these nodes do not "
            "follow each other in time: take slices with a positive stride, and rising times"
        )


def whole_of(motion: Any) -> Any:
    """The motion that knows what lies between other nodes than all of its own; None where each step
    does: all have one size, nothing is hit or leant on, and no controls follow each other.
    """
    if motion.whole is not None:
        return motion.whole
    s = motion.system.structure
    apart = motion.sizes is not None or s.contacts or (s.controls and len(motion.u) > 1)
    return motion if apart or leans(motion) else None


class State(NamedTuple):
    """One instant of a trajectory: t, and q, v, p of shape (n,)."""

    t: float
    q: np.ndarray
    v: np.ndarray
    p: np.ndarray


class StepsAgain(NamedTuple):
    """How the steps of a motion are taken once more, in the system or in a scene in which less is
    held.

    Attributes
    ----------
    ends : callable
        scene, parameter values → a function of (q, p, u, t, h) of many steps → q and p at their
        ends.
    action : callable
        scene → (q0, p0, u, params, t, h) → discrete action of a step.
    by_hand : bool
        Whether ends are interpreted ones, by no loop.
    at_once : callable or None
        motion, times → q, p and whole steps before each time; None where steps are to be taken.
    """

    ends: Callable[[System, np.ndarray], Callable[..., tuple[np.ndarray, np.ndarray]]]
    action: Callable[[System], ca.Function]
    by_hand: bool = False
    at_once: Callable[[Any, np.ndarray], tuple[np.ndarray, ...] | None] | None = None


IMPACTS = ("impact", "stop")  # events at which velocities jump


@dataclass(frozen=True, init=False)
class Event:
    """Something that happened between nodes.

    Attributes
    ----------
    time : float
        When, located with the accuracy of the rule.
    kind : str
        ``"impact"`` (a contact bounces), ``"stop"`` (a contact closes and holds), ``"detachment"``
        (it lets go), or the user's name of the expression that crossed zero.
    contact : int or None
        Index of the contact.
    impulse : float
        Normal impulse Λ of the contact: p changes by Λ ∂gap/∂q (and what constraints add).
    energy_before, energy_after : float
        Energy on both sides.
    q : tuple of float
        Coordinates there; they do not jump.
    v_before, p_before, v_after, p_after : tuple of float
        Velocities and momenta on both sides: they differ at an impact. Tuples, so that events
        compare; `before` and `after` have them as arrays.

    Examples
    --------
    >>> import varint as vi
    >>> q, v = vi.coordinates("y")
    >>> ball = vi.System(q, v, v**2 / 2 - q, contact=q, restitution=0.5)
    >>> hit = vi.simulate(ball, q0=0.5, v0=0.0, h=0.1, steps=12).events[0]
    >>> round(hit.time, 12), hit.before.v.round(12), hit.after.v.round(12)
    (1.0, array([-1.]), array([0.5]))
    """

    time: float
    kind: str
    contact: int | None
    impulse: float
    energy_before: float
    energy_after: float
    q: tuple[float, ...] = ()
    v_before: tuple[float, ...] = ()
    p_before: tuple[float, ...] = ()
    v_after: tuple[float, ...] = ()
    p_after: tuple[float, ...] = ()

    def __init__(
        self,
        time: float,
        kind: str,
        contact: int | None,
        impulse: float,
        energy_before: float,
        energy_after: float,
        q: Iterable[float] = (),
        v_before: Iterable[float] = (),
        p_before: Iterable[float] = (),
        v_after: Iterable[float] = (),
        p_after: Iterable[float] = (),
    ) -> None:
        # all at once: a run may have very many, and one by one they take three times as long
        self.__dict__.update(
            time=time,
            kind=kind,
            contact=contact,
            impulse=impulse,
            energy_before=energy_before,
            energy_after=energy_after,
            q=tuple(q),  # a file has lists
            v_before=tuple(v_before),
            p_before=tuple(p_before),
            v_after=tuple(v_after),
            p_after=tuple(p_after),
        )

    @property
    def before(self) -> State:
        """The state in which the motion comes to the event."""
        return State(self.time, *map(np.array, (self.q, self.v_before, self.p_before)))

    @property
    def after(self) -> State:
        """The state in which the motion goes on."""
        return State(self.time, *map(np.array, (self.q, self.v_after, self.p_after)))


class Costates(NamedTuple):
    """Derivatives of the optimal cost-to-go with respect to q (at constant p) and p, at every node,
    (N + 1, n) each.

    `p` are the multipliers μ_k of the rows p⁺_{k−1} − p⁻_k = 0 (at the ends ∂L/∂v(q_0, v_0) − p⁻_0
    and p⁺_{N−1} − ∂L/∂v(q_N, v_N)) in the Lagrangian cost + μ·row.
    """

    q: np.ndarray
    p: np.ndarray
