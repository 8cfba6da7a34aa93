"""The swinging Atwood machine and its second integral at the mass ratio 3.

Claim: at μ = 3, and only there, a second integral of the motion exists besides the energy; both are
kept to round-off by a rule of order 6 with a millisecond's step. Other mass ratios lose it by many
per cent: its change as a function of μ is a cusp that reaches down to round-off at 3. The error of
the state falls with h⁶.
Source: Tufillaro, Journal de Physique 47 (1986) 1111; Tufillaro, Abbott & Griffiths, American
Journal of Physics 52 (1984) 895. Reference state by a Taylor series integration in extended
precision.
Run: python examples/swinging_atwood.py [folder of the picture]
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")


def main(out: Path = Path("out")) -> None:
    figure, (regular, other, kept, scan) = plt.subplots(1, 4, figsize=(17, 4), layout="constrained")
    model = vi.models.swinging_atwood(mu=3.0)
    fine = vi.simulate(model.system, vi.gauss(6), q0=model.q0, v0=model.v0, h=0.002, duration=3.0)
    for k, (name, exact) in enumerate((("r", 1.0309249291014835), ("θ", 1.204216983590756))):
        print(f"{name} after 3 s                  found {fine.q[-1, k]:.10f}   exact {exact:.10f}")
    integral = model.invariants["Tufillaro's integral"]
    print(
        f"Tufillaro's integral         found {fine.value(integral)[-1]:.10f}   exact "
        f"{3.468358761720016:.10f}"
    )

    for axis, mu in ((regular, 3.0), (other, 2.0)):
        motion = vi.simulate(
            model.system,
            vi.gauss(3),
            q0=model.q0,
            v0=model.v0,
            h=0.001,
            duration=30.0,
            params={"mu": mu},
        )
        r, theta = motion.q.T
        axis.plot(r * np.sin(theta), -r * np.cos(theta), lw=0.4)
        axis.plot(0, 0, "ko", ms=3)
        axis.set(
            aspect="equal", xlabel="x in m", ylabel="y in m", title=f"Path of the bob, μ = {mu:g}"
        )
        value = motion.value(integral)
        kept.plot(motion.t, value / value[0], lw=0.7, label=f"second integral, μ = {mu:g}")
        print(
            f"μ = {mu:3.1f}: change of the energy {np.ptp(motion.energy):.1e}, of the integral "
            f"{np.ptp(value):.1e}"
        )
    coarse = [
        vi.simulate(model.system, vi.gauss(3), q0=model.q0, v0=model.v0, h=h, duration=3.0).q[-1]
        for h in (0.04, 0.02)
    ]
    errors = [np.abs(q - fine.q[-1]).max() for q in coarse]
    print(f"order of gauss(3)            found {np.log2(errors[0] / errors[1]):.3f}   theory 6")
    ratios = np.linspace(2.5, 3.5, 41)
    many = vi.ensemble(
        model.system,
        vi.gauss(3),
        q0=model.q0,
        v0=model.v0,
        h=0.002,
        steps=5000,
        params={"mu": ratios},
    )
    change = [np.ptp(motion.value(integral)) / abs(motion.value(integral)[0]) for motion in many]
    print(f"where the integral is kept   found {ratios[int(np.argmin(change))]:.3f}   exact 3")
    scan.semilogy(ratios, change, "o-", ms=3)
    scan.set(
        xlabel="mass ratio μ",
        ylabel="largest relative change in 10 s",
        title="The second integral over μ",
    )
    kept.set(xlabel="t in s", ylabel="value / value at the start", title="Conserved at μ = 3 only")
    kept.legend(fontsize="small")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "swinging_atwood.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))
