"""Systems learnt from data: the friction of a pendulum, the inertias of an arm, an unstable motion.

Claim: parameters come out within a few standard errors from coarse and noisy angles; what the data
cannot tell is named (of an arm in the plane they tell three combinations of four numbers); an
equation whose solutions part as e^(60 t) is fitted from a guess where no single run would last.
Source: Bock, Recent advances in parameter identification techniques for ODE, 1983; An, Atkeson &
Hollerbach, Model-Based Control of a Robot Manipulator, 1988, chapter 5 (base parameters).
Run: python examples/learnt_from_data.py [folder of the picture]
"""

import sys
import warnings
from pathlib import Path

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
RNG = np.random.default_rng(7)


def pendulum(axes: plt.Axes) -> None:
    """Friction from angles read in whole degrees."""
    q, v = vi.coordinates("theta")
    c = vi.Parameters(length=1.0, friction=0.0)
    system = vi.System(
        q, v, v**2 / 2 + 9.81 / c.length * ca.cos(q), force=-c.friction * v, params=c
    )
    true = dict(length=0.83, friction=0.11)
    motion = vi.simulate(system, q0=1.2, v0=0.0, h=0.02, steps=500, params=true)
    t = np.sort(RNG.uniform(0, 10, 150))
    degrees = np.round(np.degrees(motion.at(t).q[:, 0]))
    seen = vi.Measurement(q, t, np.radians(degrees), sigma=np.radians(1) / np.sqrt(12))
    unknown = ["length", "friction", "q0", "v0"]
    found = vi.fit(system, data=[seen], unknown=unknown, h=0.02, q0=1.0, v0=0.0)
    for name, x, s in zip(found.names, found.estimates, found.sigma, strict=True):
        if name in true:
            print(f"{name:12} found {x:.5f}   theory {true[name]}   standard error {s:.5f}")
    axes.plot(found.trajectories[0].t, np.degrees(found.trajectories[0].q[:, 0]), lw=1)
    axes.plot(t, degrees, ".", ms=4)
    axes.set(xlabel="time", ylabel="θ in degrees", title="Angles in whole degrees")


def arm(axes: plt.Axes) -> None:
    """Inertias of a two-link arm in the plane from its torques and angles."""
    q, v = vi.coordinates("shoulder", "elbow")
    u = ca.SX.sym("torque", 2)
    c = vi.Parameters(I1=1.0, I2=0.3, m2=1.5, reach=0.5)  # reach: of the second link's centre
    x = ca.vertcat(
        ca.cos(q[0]) + c.reach * ca.cos(q[0] + q[1]), ca.sin(q[0]) + c.reach * ca.sin(q[0] + q[1])
    )
    kinetic = c.I1 * v[0] ** 2 / 2 + c.I2 * (v[0] + v[1]) ** 2 / 2
    kinetic += c.m2 * ca.sumsqr(ca.jtimes(x, q, v)) / 2
    system = vi.System(q, v, kinetic, force=u, control=u, params=c)
    steps, h = 300, 0.01
    t = h * np.arange(steps)
    torque = np.column_stack([2 * np.sin(3 * t), 0.8 * np.cos(5 * t)])
    start = dict(q0=[0.2, 0.8], v0=[0.0, 0.0])
    motion = vi.simulate(system, vi.gauss(2), **start, h=h, steps=steps, u=torque)
    angles = motion.q[::5] + 1e-3 * RNG.normal(size=motion.q[::5].shape)
    seen = [vi.Experiment([vi.Measurement(q, motion.t[::5], angles, 1e-3)], **start, u=torque)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that the four are not told apart: printed below
        found = vi.fit(system, vi.gauss(2), data=seen, unknown=["I1", "I2", "m2", "reach"], h=h)
    for sentence in found.unidentifiable:
        print(f"arm, {sentence}")
    base = {
        "I1 + m2": c.I1 + c.m2,
        "m2 reach": c.m2 * c.reach,
        "I2 + m2 reach²": c.I2 + c.m2 * c.reach**2,
    }
    told = ca.Function("base", [system.c], [ca.vertcat(*base.values())])
    pairs = zip(told(found.estimates).full(), told(system.default_vector).full(), strict=True)
    for name, ([x], [true]) in zip(base, pairs, strict=True):
        print(f"{name:14} found {x:.5f}   theory {true}")
    known = vi.fit(system, vi.gauss(2), data=seen, unknown=["I1", "I2", "m2"], h=h)
    off = np.abs(known.estimates - [1.0, 0.3, 1.5]) / known.sigma
    print(f"arm, the centre known: errors of I1, I2, m2 in σ {np.round(off, 2)}")
    axes.plot(motion.t, motion.q, lw=1)
    axes.plot(motion.t[::5], angles, ".", ms=3)
    axes.set(xlabel="time", ylabel="angles in rad", title="An arm driven by known torques")


def unstable(axes: plt.Axes) -> None:
    """Bock's equation ẍ = μ² x − (μ² + p²) sin p t, p = π, from p = 0."""
    x, rate, t = *vi.coordinates("x"), vi.time()
    c = vi.Parameters(p=0.0, mu=60.0)
    drive = (c.mu**2 + c.p**2) * ca.sin(c.p * t)
    system = vi.System(x, rate, rate**2 / 2 + c.mu**2 * x**2 / 2 - drive * x, params=c, t=t)
    times = np.linspace(0, 1, 21)
    seen = vi.Measurement(x, times, np.sin(np.pi * times) + 0.05 * RNG.normal(size=21), 0.05)
    given = dict(data=seen, unknown=["p", "q0", "v0"], h=1 / 100, q0=0.0, v0=0.0)
    found = vi.fit(system, vi.gauss(4), **given, segments=10)
    p, s = found.estimates[0], found.sigma[0]
    print(f"p            found {p:.4f}   theory {np.pi:.4f}   standard error {s:.4f}")
    motion = found.trajectories[0]
    axes.plot(motion.t, motion.q, lw=1)
    axes.plot(times, seen.values, ".", ms=5)
    axes.set(xlabel="time", ylabel="x", title=f"Neighbours part as e^(60 t), p = {p:.3f}")


def main(out: Path = Path("out")) -> None:
    figure, axes = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
    for draw, at in zip((pendulum, arm, unstable), axes, strict=True):
        draw(at)
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "learnt_from_data.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))
