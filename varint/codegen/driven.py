"""Scenes whose motion is linear and driven, x' = A x + g(t) with constant A, by Gauss rules, in C:
a step is one map.
"""

from __future__ import annotations

from fractions import Fraction
from math import factorial

import casadi as ca
import numpy as np

from varint.codegen.block import block_of, start_of
from varint.codegen.core import driven_entry
from varint.codegen.graph import kernel_per_system
from varint.codegen.kernel import Kernel
from varint.codegen.mechanics import force, velocity
from varint.codegen.native import tapes_of
from varint.codegen.routines import routines
from varint.codegen.tape import NOTHING_TO_DO
from varint.discrete.linear_flow import is_gauss, is_linear_and_free
from varint.rules.rule import Rule
from varint.scene.memory import per_scene, per_system
from varint.scene.system import System

Functions = dict[str, tuple[list[ca.SX], list[ca.SX]]]
FEW_COORDINATES = 12  # beyond, what solves such a step takes long to build


@per_scene
def is_driven(system: System) -> bool:
    """Whether the motion is x' = A x + g(t, u), x = (q, p), with constant A."""
    if not is_linear_and_free(system):
        return False
    slopes, drive, x = _flow(system)
    moving = ca.vertcat(x, system.t, system.control)
    return not (ca.depends_on(slopes, moving) or ca.depends_on(drive, x))


@per_scene
def has_driven_map(system: System, rule: Rule) -> bool:
    """Whether the same, and the rule is a Gauss rule."""
    return is_gauss(rule) and is_driven(system)


@kernel_per_system
def native_driven(system: System, rule: Rule) -> Kernel:
    """The kernel of a scene of `has_driven_map`, which looks for no velocities; raises as
    `native_gauss` does.
    """
    n, stages, controls = system.q.numel(), len(rule.nodes), system.control.numel()
    slopes, drive, _ = _flow(system)
    active = [i for i in range(2 * n) if not drive[i].is_zero()]
    mass = ca.densify(ca.diag(system.mass_matrix))
    functions: Functions = {"slopes": ([], [ca.vec(ca.densify(slopes)), mass])}
    if active:
        given = [system.t, system.control] if controls else [system.t]
        functions["drive"] = given, [ca.densify(drive[active])]
    tapes = tapes_of(routines(system.c, functions))
    tables = np.array(active, dtype=float), np.array(rule.nodes), *polynomials(rule)
    members = [
        n,
        stages,
        len(active),
        controls,
        *tables,
        tapes["slopes"],
        tapes.get("drive", NOTHING_TO_DO),
    ]
    block = block_of(members)
    about = f"one linear map a step of {stages} stages"
    about += ", and the drive at its nodes" if active else ""
    operations = 2 * n * (2 * n + len(active))
    return Kernel(
        *(about, n, controls, stages, operations, driven_entry()),
        carry_size=2 + 4 * n,
        scene=start_of(block),
        block=block,
    )


def polynomials(rule: Rule) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coefficients by powers of z of Q = det(1 − z a) and Q (R − 1), (s + 1,), and those of
    Q bᵀ(1 − z a)⁻¹, (s, s + 1), a row for each stage.

    R is the diagonal Padé approximant of exp (Hairer & Wanner, Solving Ordinary Differential
    Equations II, IV.3). By the rule's simplifying conditions D(s), Σ b_i c_i^{k−1} a_ij = b_j
    (1 − c_j^k)/k (Hairer, Nørsett & Wanner, I, II.7), the rows of bᵀaᵏ are b (1 − c)ᵏ/k! for k < s;
    higher powers of the product are zero.
    """
    s = len(rule.nodes)
    part = [
        Fraction(factorial(2 * s - k) * factorial(s), factorial(2 * s) * factorial(k))
        / factorial(s - k)
        for k in range(s + 1)
    ]
    left = [(-1) ** k * x for k, x in enumerate(part)]
    late = [1 - Fraction(c) for c in rule.nodes]
    of = [
        [
            Fraction(b) * sum(left[j] * c ** (k - j) / factorial(k - j) for j in range(k + 1))
            for k in range(s)
        ]
        + [Fraction(0)]
        for b, c in zip(rule.weights, late, strict=True)
    ]
    odd = [x - y for x, y in zip(part, left, strict=True)]
    return np.array(left, dtype=float), np.array(odd, dtype=float), np.array(of, dtype=float)


@per_system
def _flow(system: System) -> tuple[ca.SX, ca.SX, ca.SX]:
    """A, g(t, u) and x."""
    n = system.q.numel()
    x = ca.SX.sym("x", 2 * n)
    at = ca.vertcat(system.q, system.v)
    speed = ca.densify(velocity(system, x[n:]))
    rate = ca.vertcat(speed, ca.densify(force(system)))
    rate = ca.substitute(rate, at, ca.vertcat(x[:n], ca.substitute(speed, system.q, x[:n])))
    slopes = ca.jacobian(rate, x)
    drive = ca.densify(ca.substitute(rate, x, ca.SX.zeros(2 * n)))
    return slopes, ca.simplify(drive), x
