"""Andrews' squeezing mechanism and a heavy top by quaternion: closed loops and rotations without
special coordinates.

Claim: with multipliers at every control point lobatto(5) carries the seven bodies and six loop
equations of Andrews' mechanism to the reference at t = 0.03 s within round-off, in the joint
reactions too; the heavy top by unit quaternion, whose mass matrix is singular, keeps energy, spin
and vertical angular momentum.

Source: Hairer & Wanner, Solving ODEs II, VII.7; Landau & Lifshitz, Mechanics, §35. The reference is
a Taylor series integration in extended precision of the same equations.

Run: python examples/closed_loops.py. Writes out/closed_loops.png.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")

OUT = Path("out")
ANGLES = np.array(  # at t = 0.03 s
    [
        15.810771195153707,
        -15.756371058411839,
        0.0408222401196458,
        -0.5347301163420796,
        0.524409965879954,
        0.5347301163420796,
        1.048080741041938,
    ]
)
REACTIONS = -np.array(  # the source subtracts Gᵀλ
    [
        199.17534810453864,
        -29.755309974971762,
        23.06654361162215,
        31.452725275771137,
        22.64249478639438,
        11.617392352611256,
    ]
)


def main() -> None:
    model = vi.models.andrews_mechanism()
    print(f"{'rule':>14} {'h / s':>8} {'µs a step':>10} {'angles':>9} {'reactions':>9}")
    for rule, h in ((vi.lobatto(3), 2.5e-5), (vi.lobatto(4), 5e-5), (vi.lobatto(5), 5e-5)):
        for _ in range(2):  # the first run builds
            squeeze = vi.simulate(model.system, rule, **model.start | {"h": h})
        cost = squeeze.stats["seconds"] / squeeze.stats["steps"] * 1e6
        errors = (
            np.abs(squeeze.q[-1] - ANGLES).max(),
            np.abs(squeeze.multipliers[-1] / REACTIONS - 1).max(),
        )
        print(f"{rule!r:>14} {h:8.1e} {cost:10.1f} {errors[0]:9.1e} {errors[1]:9.1e}")
    print(f"crank angle at 0.03 s, rad    found {squeeze.q[-1, 0]:.12f}   exact {ANGLES[0]:.12f}")
    print(
        f"first reaction at 0.03 s, N   found {squeeze.multipliers[-1, 0]:.10f}   exact "
        f"{REACTIONS[0]:.10f}"
    )
    model = vi.models.heavy_top_quaternion()
    top = vi.simulate(model.system, vi.lobatto(4), **model.start)
    for name, expression in model.invariants.items():
        values = top.value(expression)
        print(f"heavy top, {name}: changes by {np.abs(values - values[0]).max():.1e}")
    OUT.mkdir(exist_ok=True)
    picture(squeeze, top).savefig(OUT / "closed_loops.png", dpi=150)
    print(f"wrote {OUT / 'closed_loops.png'}")


def picture(squeeze: vi.Trajectory, top: vi.Trajectory) -> plt.Figure:
    """Reactions of the mechanism; path of the top's axis on the sphere, seen from above."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.2), layout="constrained")
    left.plot(squeeze.t * 1e3, squeeze.multipliers, lw=1.2)
    left.set(xlabel="t / ms", ylabel="loop reactions λ / N", title="Andrews' mechanism")
    axis = top.value(vi.models.rotation(top.system.q))[:, :, 2]
    right.plot(axis[:, 0], axis[:, 1], lw=1.2)
    right.set(aspect="equal", xlabel="axis, x", ylabel="axis, y", title="Heavy top by quaternion")
    return figure


if __name__ == "__main__":
    main()
