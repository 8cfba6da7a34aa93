"""The verification page: orders and invariants measured by `varint.diagnostics` with this
version, and known limits.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from state import package_state, write_if_changed

import varint as vi

HERE = Path(__file__).resolve().parent
LIMITS = HERE.parent / "known_limits.md"


@dataclass(frozen=True)
class Scene:
    """A scene, and the rules that are measured on it."""

    title: str
    model: vi.models.Model
    h: float
    rules: tuple[vi.Rule, ...]


# every family of rules on nonlinear scenes: linear ones super-converge; at steps where an order
# shows
SCENES = (
    Scene(
        "Double pendulum",
        vi.models.double_pendulum(),
        0.05,
        (*(vi.gauss(s) for s in (1, 2, 3, 4)), *(vi.lobatto(s) for s in (2, 3, 4))),
    ),
    Scene(
        "Hénon–Heiles",
        vi.models.henon_heiles(),
        0.4,
        tuple(
            vi.composition(name) for name in ("verlet", "blanes-moan4", "blanes-moan6", "kahan-li8")
        ),
    ),
    Scene(
        "Charge in uniform fields",
        vi.models.uniform_fields(v0=(0.5, 0.1, 0.2)),
        0.1,
        (vi.gauss(2), vi.lobatto(3)),
    ),
    Scene(
        "Pendulum in Cartesian coordinates",
        vi.models.pendulum_cartesian(),
        0.01,
        tuple(vi.lobatto(s) for s in (2, 3, 4)),
    ),
    Scene("Heavy top by unit quaternion", vi.models.heavy_top_quaternion(), 0.01, (vi.lobatto(3),)),
)
LONG = 2000


def write(path: Path) -> None:
    """Measure, unless this version of the package has been measured."""
    mark = f"<!-- {package_state()} -->"
    if path.exists() and mark in path.read_text(encoding="utf-8"):
        return
    tables = "\n\n".join(_table(scene) for scene in SCENES)
    text = f"""{mark}
# Verification

These figures were measured by `vi.diagnostics` while this page was built, with varint {vi.__version__}: nothing on it
is typed in by hand. Orders are slopes of log error over log step, for q and for p; the symplectic defect is ‖AᵀJA − J‖
with A the exact derivative of a step, on tangent vectors where there are constraints; the energy column is the
amplitude of its oscillation and whether its windowed means drift over {LONG} steps; momenta are the drift of every
quantity that the rule must keep exactly; reversibility runs there and back.

{tables}

The same properties, and their failure for explicit Euler and RK4, are tests: `tests/integration/test_orders.py`,
`tests/integration/test_invariants.py`, `tests/symmetry/test_noether_rules.py`, `tests/diagnostics/test_diagnostics.py`. Your own scene is measured by

```python
import casadi as ca
import varint as vi

q, v = vi.coordinates("theta")
system = vi.System(q, v, v**2 / 2 + 9.81 * ca.cos(q))
print(vi.diagnostics.self_test(system, vi.gauss(2), q0=1.0, v0=0.0, h=0.05))
```

or, for a ready model, by `python -m varint check pendulum`.

{LIMITS.read_text(encoding="utf-8")}"""
    write_if_changed(path, text)


def _table(scene: Scene) -> str:
    model = scene.model
    lines = [
        f"## {scene.title}\n\n{model.claim} ({model.source})\n",
        "| rule | order | q | p | symplectic defect | energy | momenta | there and back | g, G v |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for rule in scene.rules:
        test = vi.diagnostics.self_test(
            model.system, rule, q0=model.q0, v0=model.v0, h=scene.h, steps=LONG
        )
        kept = [
            m.drift for m in test.conserved if m.expected is not None and m.symmetry.tau.is_zero()
        ]
        drifts = {True: "no drift", False: "**drifts**", None: "work is done"}[test.energy.passed]
        rows = test.constraints
        cells = [
            f"`{rule}`",
            str(rule.order),
            f"{test.convergence.q_order:.2f}",
            f"{test.convergence.p_order:.2f}",
            f"{test.symplectic.worst:.0e}",
            f"{test.energy.oscillation:.0e}, {drifts}",
            f"{max(kept):.0e}" if kept else "–",
            f"{test.reversibility.error:.0e}",
            "–" if rows.passed is None else f"{rows.position:.0e}, {rows.velocity:.0e}",
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)
