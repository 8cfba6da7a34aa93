"""Hénon–Heiles: from order to chaos, seen in a surface of section.

Claim: at E = 1/12 the section x = 0 consists of curves, at E = 1/8 most of it is a chaotic sea; in
both a symplectic rule of order 4 keeps the energy in bounds over the whole run.
Source: Hénon & Heiles, Astronomical Journal 69 (1964) 73.
Run: python examples/henon_heiles.py [folder of the picture]
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
RULE = vi.composition("blanes-moan4")


def section(motion: vi.Trajectory) -> np.ndarray:
    """y and p_y where x grows through zero, linear between close nodes."""
    x = motion.q[:, 0]
    k = np.flatnonzero((x[:-1] < 0) & (x[1:] >= 0))
    part = (-x[k] / (x[k + 1] - x[k]))[:, None]
    y = np.stack([motion.q[:, 1], motion.p[:, 1]], -1)
    return (1 - part) * y[k] + part * y[k + 1]


def main(out: Path = Path("out")) -> None:
    model = vi.models.henon_heiles()
    figure, axes = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
    for axis, total, name in ((axes[0], 1 / 12, "1/12"), (axes[1], 1 / 8, "1/8")):
        worst = 0.0
        for y0, slope in (
            (-0.2, 0.0),
            (-0.05, 0.0),
            (0.1, 0.0),
            (0.25, 0.0),
            (0.0, 0.15),
            (0.0, 0.3),
        ):
            speed = np.sqrt(2 * total - y0**2 + 2 * y0**3 / 3 - slope**2)
            motion = vi.simulate(
                model.system, RULE, q0=[0.0, y0], v0=[speed, slope], h=0.05, duration=2000.0
            )
            axis.plot(*section(motion).T, ".", ms=1.5)
            worst = max(worst, np.abs(motion.energy - total).max())
        axis.set(xlabel="y", ylabel="p_y", title=f"E = {name}: section x = 0")
        print(f"largest energy error at E = {name:4} {worst:.1e}")

    # the state after 100 time units, against an integration in extended precision
    reference = np.array([0.08711046349968105, 0.33362404166901966])
    for rule in (vi.composition("verlet"), RULE, vi.composition("kahan-li8")):
        errors, steps = [], np.array([1000, 2000, 4000, 8000])
        for count in steps:
            run = vi.simulate(
                model.system, rule, q0=model.q0, v0=model.v0, duration=100.0, steps=int(count)
            )
            errors.append(np.abs(run.q[-1] - reference).max())
        kicks = steps * (len(rule.kicks) - 1)
        axes[2].loglog(kicks, errors, "o-", label=f"{rule}")
        if rule.order > 2:
            print(f"y(100), {rule!r:29} found {run.q[-1, 1]:.9f}   exact {reference[1]:.9f}")
    axes[2].set(
        xlabel="force evaluations", ylabel="error at t = 100", title="Work and precision, E = 1/12"
    )
    axes[2].legend(fontsize="small")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "henon_heiles.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))
