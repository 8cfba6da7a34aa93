"""What a ready scene consists of."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.scene.system import System

Motion = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True, eq=False)
class Model:
    """A scene with initial data, invariants and, where one exists, its motion in closed form.

    Attributes
    ----------
    name : str
        Name of the factory.
    system : System
        Lagrangian with all physical quantities as parameters.
    q0, v0 : array (n,)
        Initial configuration and velocity.
    duration, h : float
        Time span that shows the behaviour, and a step that resolves it.
    claim : str
        What must come out, in one sentence.
    source : str
        Where the scene and its claim come from.
    invariants : mapping of str to SX
        Expressions of q, v, t and the parameters, scalar or vector, that stay constant along every
        motion.
    exact : callable or None
        ``q, v = exact(times)``, arrays (N, n), of the motion from (q0, v0) at t = 0 with the
        default parameters.

    Examples
    --------
    >>> import varint as vi
    >>> model = vi.models.pendulum(theta0=1.0)
    >>> sorted(model.invariants), model.exact(0.0)[0]
    (['energy'], array([[1.]]))
    """

    name: str
    system: System
    q0: Any
    v0: Any
    duration: float
    h: float
    claim: str
    source: str
    invariants: Mapping[str, ca.SX] = field(default_factory=dict)
    exact: Motion | None = None

    def __post_init__(self) -> None:
        n = self.system.q.numel()
        for name in ("q0", "v0"):
            value = np.atleast_1d(np.asarray(getattr(self, name), dtype=float))
            if value.shape != (n,) or not np.isfinite(value).all():
                raise InputError(
                    f"{name} of the model {self.name} must be {n} finite numbers, got {value}"
                )
            object.__setattr__(self, name, value)
        if self.exact is not None:
            object.__setattr__(self, "exact", _time_first(self.exact, n))

    @property
    def start(self) -> dict[str, Any]:
        """The arguments of a run, controls at zero: ``simulate(model.system, **model.start)``."""
        start = {"q0": self.q0, "v0": self.v0, "h": self.h, "duration": self.duration}
        controls = self.system.structure.controls
        return start | ({"u": np.zeros(controls)} if controls else {})


def _time_first(motion: Motion, n: int) -> Motion:
    """The motion as a function of any array of times, returning q and v of shape (N, n)."""

    def exact(times: Any) -> tuple[np.ndarray, np.ndarray]:
        times = np.atleast_1d(np.asarray(times, dtype=float))
        q, v = motion(times)
        return np.reshape(q, (len(times), n)), np.reshape(v, (len(times), n))

    return exact


def energy(system: System) -> dict[str, ca.SX]:
    """The energy as an entry of `Model.invariants`."""
    return {"energy": system.energy}
