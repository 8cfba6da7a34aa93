"""Reference values; each entry of `reference/` says where it comes from."""

from __future__ import annotations

import json
from pathlib import Path

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp

import varint as vi


def entries(name: str) -> dict:
    """The entries of a file of `reference/`, by their names."""
    path = Path(__file__).parent / "reference" / f"{name}.json"
    return json.loads(path.read_text(encoding="utf-8"))


def given_and_exact(name: str, entry: str) -> tuple[dict, dict]:
    """What an entry of a file is for, and its values."""
    found = entries(name)[entry]
    return found["params"], found["reference"]


def end_by_dop853(system: vi.System, q0, v0, duration: float) -> np.ndarray:
    """Coordinates at the end by an explicit method of order 8 at round-off, from the equations of
    Euler and Lagrange alone: of free scenes without explicit time.
    """
    s, n = system, len(q0)
    push = ca.gradient(s.lagrangian, s.q) - ca.jacobian(s.momentum, s.q) @ s.v
    push += s.force if s.structure.forced else 0
    a = ca.Function("a", [s.q, s.v], [ca.solve(ca.densify(s.mass_matrix), push)])
    found = solve_ivp(
        lambda _, y: np.append(y[n:], a(y[:n], y[n:]).full()),
        (0.0, duration),
        np.append(q0, v0),
        method="DOP853",
        rtol=3e-14,
        atol=1e-15,
    )
    return found.y[:n, -1]
