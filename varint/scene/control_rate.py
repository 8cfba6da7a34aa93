"""The rate of change of a control, as a symbol for costs and bounds."""

from __future__ import annotations

from typing import Any

import casadi as ca

from varint.scene.validation import symbols

# the control that each rate belongs to, by the hash of the rate; both are held, so that hashes stay
# their own
_KNOWN: dict[int, tuple[ca.SX, ca.SX]] = {}
_SAME: dict[int, ca.SX] = {}


def control_rate(control: Any) -> ca.SX:
    """du/dt of controls that are piecewise linear, or their steps over the duration of a step.

    With ``control="linear"`` it is the slope (u_{k+1} − u_k)/h_k within step k; with
    ``control="constant"`` the change (u_{k+1} − u_k)/h_k to the next step, for all but the last.

    Parameters
    ----------
    control : SX (k,)
        Control symbols.

    Returns
    -------
    SX (k,)
        Symbols for costs and bounds of optimal control.

    Raises
    ------
    InputError
        If these are no symbols.

    Examples
    --------
    >>> import casadi as ca
    >>> import varint as vi
    >>> q, v = vi.coordinates("x")
    >>> force = ca.SX.sym("force")
    >>> rate = vi.control_rate(force)
    >>> cart = vi.System(q, v, v**2 / 2, force=force, control=force)
    >>> smooth = vi.optimal_control(
    ...     cart, vi.gauss(2), duration=1, steps=20, cost=rate**2, control="linear",
    ...     bounds=[(-50, rate, 50)], start=dict(q=[0], v=[0]), end=dict(q=[1], v=[0]))
    >>> round(smooth.cost, 2)
    144.0
    """
    found = []
    for one in ca.vertsplit(symbols("control", control)):
        key = one.element_hash()
        if key not in _SAME:
            rate = _SAME[key] = ca.SX.sym(f"{one.name()}_rate")
            _KNOWN[rate.element_hash()] = (rate, one)
        found.append(_SAME[key])
    return ca.vertcat(*found)


def rates_in(*expressions: ca.SX) -> list[tuple[ca.SX, ca.SX]]:
    """The rates in these expressions, each with its control."""
    found = {x.element_hash(): x for e in expressions for x in ca.symvar(e)}
    return [_KNOWN[key] for key in found if key in _KNOWN]
