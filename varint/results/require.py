"""Refusals of what is no motion."""

from __future__ import annotations

from typing import Any

from varint.errors import InputError
from varint.results.trajectory import Trajectory


def require_trajectory(x: Any) -> None:
    """Refuse what is no trajectory where one is expected."""
    if not isinstance(x, Trajectory):
        raise InputError(
            f"a motion from simulate() is wanted, got {type(x).__name__}; of an ensemble take one "
            "member, runs[i]"
        )
