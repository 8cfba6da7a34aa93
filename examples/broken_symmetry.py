"""A broken symmetry is seen to break, and by exactly what forces give.

Claim: drag turns the conserved angular momentum of a planet into a balance, J_N − J_0 = Σ
(f⁻·ξ(q_k) + f⁺·ξ(q_{k+1})), which every rule obeys to round-off although J itself has only the
rule's order: J = J_0 e^{−γt}. (dJ/dt is the torque q × F = −γ q × v = −γ J.) The balance holds for
steps of any size; the error of J falls with h^order.
Source: Marsden & West, Discrete mechanics and variational integrators, Acta Numerica 2001, §3.2.5.
Run: python examples/broken_symmetry.py [folder of the picture]
"""

import sys
from pathlib import Path

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
DRAG = 0.01
START = dict(q0=[1.0, 0.0], v0=[0.0, 0.9])


def planet(drag: float) -> vi.System:
    """A planet in a medium, F = −γ v."""
    q, v = vi.coordinates("x", "y")
    return vi.System(q, v, ca.sumsqr(v) / 2 + 1 / ca.norm_2(q), force=-drag * v)


def main(out: Path = Path("out")) -> None:
    system = planet(DRAG)
    print(vi.symmetries(system))
    try:
        vi.noether(system, [1, 0])
    except vi.InputError as refusal:
        print(f"\na translation: {refusal}\n")
    figure, (value, balance) = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
    for rule in (vi.midpoint(), vi.gauss(2), vi.lobatto(4)):
        motion = vi.simulate(system, rule, h=0.02, steps=2500, **START)
        spin = motion.conserved()["rotation about z"]
        print(spin)
        print(
            f"change of J by {rule!s:14}  found {spin.change:.13f}   exact "
            f"{spin.expected_change:.13f}"
        )
        theory = 0.9 * np.exp(-DRAG * motion.t)
        value.plot(motion.t, spin.values, lw=1, label=str(rule))
        balance.semilogy(
            motion.t,
            np.abs(spin.values - theory) + 1e-17,
            lw=0.8,
            label=f"{rule}: J − J₀e$^{{−γt}}$",
        )
        balance.semilogy(
            motion.t, np.maximum.accumulate(np.abs(spin.error)) + 1e-17, "--", lw=1, label="balance"
        )
    for rule in (vi.midpoint(), vi.gauss(2)):
        ends = [
            vi.simulate(system, rule, h=h, duration=40.0, **START)
            .conserved()["rotation about z"]
            .values[-1]
            for h in (0.04, 0.02)
        ]
        errors = [abs(end - 0.9 * np.exp(-DRAG * 40.0)) for end in ends]
        print(
            f"order of J by {rule!s:15} found {np.log2(errors[0] / errors[1]):.3f}   theory "
            f"{rule.order}"
        )
    print(f"J at the end                  found {spin.values[-1]:.10f}   exact {theory[-1]:.10f}")
    value.plot(motion.t, theory, "k:", lw=2, label="theory")
    value.set(xlabel="t", ylabel="$J$", title="Angular momentum under drag")
    balance.set(
        xlabel="t", ylabel="error", title="Error of J, and of its balance", ylim=(1e-17, 1e-3)
    )
    value.legend(fontsize="small")
    balance.legend(fontsize="x-small", ncols=3)
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "broken_symmetry.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))
