"""Scenes that were seen before: what is built for one serves all that are made alike."""

from __future__ import annotations

import threading
from collections import OrderedDict
from typing import Any

import casadi as ca

MOST = 64  # scenes that are remembered though nobody else holds them
LONG = 20_000  # bytes of a description of which the digest alone is kept
_SEEN: OrderedDict[tuple[str | bytes, ...], Any] = OrderedDict()
_LOOKING = threading.Lock()


def first_alike(system: Any) -> Any:
    """The first of the systems seen lately with the same symbols and expressions, or this one.

    Their parameters may have other values. What depends on operations alone, and holds no symbols,
    is built for that one system: a model made again and again is arranged once.
    """
    found = system.__dict__.get("_first_alike")
    if found is None:
        key = _key(system)
        with _LOOKING:
            found = _SEEN.setdefault(key, system)
            _SEEN.move_to_end(key)
            if len(_SEEN) > MOST:
                _SEEN.popitem(last=False)
        found = system.__dict__.setdefault("_first_alike", found)
    return found


def _key(system: Any) -> tuple[str | bytes, ...]:
    """Names, operations and their constants, to the bit."""
    s = system
    inputs = [s.q, s.v, s.t, s.control, s.c]
    outputs = [s.lagrangian, s.force, s.constraint, s.nonholonomic, s.contact, s.bounce]
    if s.kinetics is not None:
        inputs.append(s.kinetics.momentum)
        k = s.kinetics
        outputs += [k.mass_matrix, k.velocity, k.stiffness, k.damping, k.slopes]
    text: str | bytes = ca.Function("scene", inputs, outputs).serialize()
    if isinstance(text, str) and len(text) > LONG:
        import hashlib  # which takes longer to import than to describe a small scene

        text = hashlib.sha256(text.encode()).digest()
    # which equations of a scene with constraints are solved is a question of ranks
    numbers = s.default_vector.tobytes() if s.constraint.numel() else b""
    return text, numbers, repr(s.rays)
