"""Estimator and controller in one loop: a cart-pole swung up from noisy angle and position alone.

Claim: speeds that nothing measures come out of the last 0.4 s of angles and positions, with
standard errors that the true errors obey; with them a pole is swung up and held though it is a
tenth heavier than the model and shaken at every step; both are built once and take milliseconds.
Source: Rawlings, Mayne & Diehl, Model Predictive Control, 2nd ed., §4.3 (moving-horizon
estimation) and §1.3; cart-pole of Kelly (2017).
Run: python examples/estimated_cart_pole.py [folder of the picture]
"""

import sys
from pathlib import Path
from time import perf_counter

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
H, STEPS, AHEAD, BACK = 0.04, 120, 30, 10
NOISE = np.array([0.01, 0.02])  # m and rad
SHAKEN = np.array([0.01, 0.004])  # momentum that every step adds from outside


def controller(system: vi.System) -> vi.Controller:
    """Predictive control 1.2 s ahead."""
    (x, angle), (speed, rate), push = ca.vertsplit(system.q), ca.vertsplit(system.v), system.control
    off = 2 * (1 + ca.cos(angle))  # ≈ (θ − π)² near the top
    cost = 5 * x**2 + 20 * off + 0.1 * speed**2 + 0.1 * rate**2 + 0.02 * push**2
    end = 10 * x**2 + 60 * off + 2 * speed**2 + rate**2
    ahead = vi.Phase(
        system,
        vi.gauss(2),
        H * AHEAD,
        AHEAD,
        cost,
        terminal_cost=end,
        bounds=[(-12, push, 12), (-1.5, x, 1.5)],
    )
    return vi.mpc(ahead)


def main(out: Path = Path("out")) -> None:
    system, rng = vi.models.cart_pole().system, np.random.default_rng(3)
    plant = vi.models.cart_pole(m=0.33).system  # what really moves, 10 % heavier
    steer = controller(system)
    look = vi.mhe(
        system,
        vi.gauss(2),
        h=H,
        horizon=BACK,
        measured=system.q,
        sigma=NOISE,
        q0=[0, 0],
        v0=[0, 0],
        start_sigma=[0.1, 0.3, 0.5, 0.5],
        disturbance=2 * SHAKEN,  # the pole's weight is not known exactly either
    )
    q, v = np.array([0.0, 0.2]), np.zeros(2)
    estimate = plan = u = None
    true, seen, found, spread, spent = [], [], [], [], []
    for k in range(STEPS):
        y = q + NOISE * rng.normal(size=2)
        began = perf_counter()
        estimate = look(y, u, estimate)
        spent.append(perf_counter() - began)
        plan = steer(estimate.q, estimate.v, plan, k * H)
        u = plan.u[0]
        true.append([*q, *v])
        seen.append(y)
        found.append([*estimate.q, *estimate.v])
        spread.append(np.sqrt(np.diag(estimate.covariance)))
        moved = vi.simulate(plant, vi.gauss(2), q0=q, v0=v, h=H, steps=1, u=u[None])
        kicked = moved.p[-1] + SHAKEN * rng.normal(size=2)
        shaken = vi.simulate(plant, q0=moved.q[-1], p0=kicked, h=H, steps=1, u=[0])
        q, v = shaken.q[0], shaken.v[0]
    t = H * np.arange(STEPS)
    true, seen, found, spread = (np.array(x) for x in (true, seen, found, spread))
    error = (found - true)[20:] / spread[20:]
    print(f"errors over standard errors, root mean square: {np.sqrt((error**2).mean(axis=0))}")
    print(f"an estimate takes {1e3 * np.median(spent):.1f} ms")
    top = np.abs(true[-40:, 1]).mean()
    print(f"mean angle of the last 1.6 s   found {top:.4f}   theory {np.pi:.4f}")
    figure, (path, rates) = plt.subplots(1, 2, figsize=(12, 4), layout="constrained")
    for i, name in enumerate(("cart, m", "pole, rad")):
        path.plot(t, true[:, i], lw=1.2, color=f"C{i}", label=name)
        path.plot(t, seen[:, i], ".", ms=3, color=f"C{i}")
    rates.plot(t, true[:, 3], lw=1.2, label="true")
    low, high = (found[:, 3] + sign * 2 * spread[:, 3] for sign in (-1, 1))
    rates.fill_between(t, low, high, alpha=0.3, color="C1", lw=0, label="estimated, ±2σ")
    raw = np.gradient(seen[:, 1], H)
    rates.plot(t, raw, ".", ms=3, color="0.6", label="differences of angles")
    path.set(xlabel="t in s", title="Motion, and what is measured of it")
    rates.set(xlabel="t in s", ylabel="rad/s", title="Rate of the pole, which is not measured")
    path.legend(fontsize="small")
    rates.legend(fontsize="small")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "estimated_cart_pole.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))
