"""Closed loops: slider-crank, four-bar, Andrews' squeezing mechanism."""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.models.model import Model, energy
from varint.scene.parameters import Parameters
from varint.scene.system import System, coordinates


def slider_crank(phi0: float = 0.3, phidot0: float = 20.0) -> Model:
    """Crank, rod and slider as three free bodies in the plane (x, y, angle each), eight joint
    constraints, one freedom.

    The multipliers are the joint forces: of the bearing on the crank, minus those of crank on rod
    and of rod on slider, of the guide on the slider, and the guide's torque.
    """
    c = Parameters(
        l1=0.15,
        l2=0.3,
        m1=0.36,
        m2=0.151104,
        m3=0.075552,
        J1=0.000675,
        J2=0.00113328,
        J3=1e-4,
        gravity=9.81,
    )
    q, v = coordinates("x1", "y1", "phi", "x2", "y2", "psi", "x3", "y3", "turn")
    masses = ca.vertcat(c.m1, c.m1, c.J1, c.m2, c.m2, c.J2, c.m3, c.m3, c.J3)
    potential = c.gravity * (c.m1 * q[1] + c.m2 * q[4] + c.m3 * q[7])
    arm1 = c.l1 / 2 * ca.vertcat(ca.cos(q[2]), ca.sin(q[2]))
    arm2 = c.l2 / 2 * ca.vertcat(ca.cos(q[5]), ca.sin(q[5]))
    crank, rod, slider = q[0:2], q[3:5], q[6:8]
    joints = ca.vertcat(crank - arm1, crank + arm1 - (rod - arm2), rod + arm2 - slider, q[7], q[8])
    system = System(q, v, ca.dot(masses, v**2) / 2 - potential, constraint=joints, params=c)
    psi0 = -np.arcsin(0.5 * np.sin(phi0))
    psidot0 = -0.5 * np.cos(phi0) / np.cos(psi0) * phidot0
    end, start = (
        np.array([np.cos(phi0), np.sin(phi0)]) * 0.15,
        np.array([-np.sin(phi0), np.cos(phi0)]) * 0.15 * phidot0,
    )
    half = np.array([np.cos(psi0), np.sin(psi0)]) * 0.15
    turn = np.array([-np.sin(psi0), np.cos(psi0)]) * 0.15 * psidot0
    q0 = np.concatenate([end / 2, [phi0], end + half, [psi0], end + 2 * half, [0]])
    v0 = np.concatenate([start / 2, [phidot0], start + turn, [psidot0], start + 2 * turn, [0]])
    q0[7] = v0[7] = 0.0
    return Model(
        name="slider_crank",
        system=system,
        q0=q0,
        v0=v0,
        duration=0.5,
        h=0.001,
        invariants=energy(system),
        claim=(
            "One freedom is left: the crank turns with the period of its energy integral; energy "
            "is kept."
        ),
        source=(
            "Simeon, Computational Flexible Multibody Dynamics (2013), §1.3: the masses and "
            "lengths."
        ),
    )


def four_bar(loops: int = 2, thetadot0: float = 1.0) -> Model:
    """N parallelograms in a row, uniform rods of length and mass 1: N + 1 cranks and N couplers
    (IFToMM A02).

    Where the cranks lie level the linkage folds and its constraints are dependent; a step over that
    instant stays on the parallel branch.
    """
    c = Parameters(gravity=9.81)
    q, v = coordinates(*(f"{axis}{i}" for i in range(loops + 1) for axis in "xy"))
    ends, speeds = ca.vertsplit(q, 2), ca.vertsplit(v, 2)
    feet = [ca.DM([float(i), 0.0]) for i in range(loops + 1)]
    still = ca.SX.zeros(2, 1)
    rods = [(feet[i], ends[i], still, speeds[i]) for i in range(loops + 1)]
    rods += [(ends[i], ends[i + 1], speeds[i], speeds[i + 1]) for i in range(loops)]
    kinetic = sum((ca.sumsqr(va) + ca.sumsqr(vb) + ca.dot(va, vb)) / 6 for _, _, va, vb in rods)
    potential = c.gravity * sum((a[1] + b[1]) / 2 for a, b, _, _ in rods)
    lengths = ca.vertcat(*(ca.sumsqr(b - a) - 1 for a, b, _, _ in rods))
    system = System(q, v, kinetic - potential, constraint=lengths, params=c)
    return Model(
        name="four_bar",
        system=system,
        duration=0.7,
        h=0.005,
        invariants=energy(system),
        q0=np.ravel([[i, 1.0] for i in range(loops + 1)]),
        v0=np.ravel([[thetadot0, 0.0]] * (loops + 1)),
        claim="All cranks turn alike: ((N+1)/3 + N) θ̈ = ((N+1)/2 + N) g sin θ.",
        source="IFToMM Technical Committee for Multibody Dynamics, benchmark A02.",
    )


ANDREWS = dict(
    m1=0.04325,
    m2=0.00365,
    m3=0.02373,
    m4=0.00706,
    m5=0.0705,
    m6=0.00706,
    m7=0.05498,
    i1=2.194e-6,
    i2=4.41e-7,
    i3=5.255e-6,
    i4=5.667e-7,
    i5=1.169e-5,
    i6=5.667e-7,
    i7=1.912e-5,
    xa=-0.06934,
    ya=-0.00227,
    xb=-0.03635,
    yb=0.03273,
    xc=0.014,
    yc=0.072,
    c0=4530.0,
    l0=0.07785,
    mom=0.033,
    d=0.028,
    da=0.0115,
    e=0.02,
    ea=0.01421,
    rr=0.007,
    ra=0.00092,
    ss=0.035,
    sa=0.01874,
    sb=0.01043,
    sc=0.018,
    sd=0.02,
    ta=0.02308,
    tb=0.00916,
    u=0.04,
    ua=0.01228,
    ub=0.00449,
    zf=0.02,
    zt=0.04,
    fa=0.01421,
)
ANDREWS_START = [
    -0.06171389001427645,
    0.0,
    0.45527981916307037,
    0.22266839016588588,
    0.48736497954384256,
    -0.22266839016588588,
    1.2305474445498212,
]


def andrews_mechanism() -> Model:
    """Andrews' squeezing mechanism: seven bodies, seven angles, six loop constraints, driven by a
    constant torque.

    The multipliers have the opposite sign of those in the source, which writes M q̈ = f − Gᵀλ.
    """
    c = Parameters(**ANDREWS)
    q, v = coordinates("beta", "theta", "gamma", "phi", "delta", "omega", "epsilon")
    beta, theta, gamma, phi, delta, omega, epsilon = ca.vertsplit(q)
    b, th, ga, ph, de, om, ep = ca.vertsplit(v)
    e, f = c.e - c.ea, c.zf - c.fa
    kinetic = (
        c.m1 * (c.ra * b) ** 2
        + c.m2
        * (
            (c.rr * b) ** 2
            - 2 * c.da * c.rr * ca.cos(theta) * b * (b + th)
            + (c.da * (b + th)) ** 2
        )
        + c.i1 * b**2
        + c.i2 * (b + th) ** 2
        + (c.m3 * (c.sa**2 + c.sb**2) + c.i3) * ga**2
        + c.m4
        * ((c.zt * de) ** 2 + 2 * c.zt * e * ca.sin(phi) * de * (ph + de) + (e * (ph + de)) ** 2)
        + c.i4 * (ph + de) ** 2
        + (c.m5 * (c.ta**2 + c.tb**2) + c.i5) * de**2
        + c.m6
        * ((c.u * ep) ** 2 - 2 * c.u * f * ca.sin(omega) * ep * (om + ep) + (f * (om + ep)) ** 2)
        + c.i6 * (om + ep) ** 2
        + (c.m7 * (c.ua**2 + c.ub**2) + c.i7) * ep**2
    ) / 2
    spring_x = c.sd * ca.cos(gamma) + c.sc * ca.sin(gamma) + c.xb - c.xc
    spring_y = c.sd * ca.sin(gamma) - c.sc * ca.cos(gamma) + c.yb - c.yc
    stretch = ca.sqrt(spring_x**2 + spring_y**2) - c.l0
    tip_x = c.rr * ca.cos(beta) - c.d * ca.cos(beta + theta)
    tip_y = c.rr * ca.sin(beta) - c.d * ca.sin(beta + theta)
    loops = ca.vertcat(
        tip_x - c.ss * ca.sin(gamma) - c.xb,
        tip_y + c.ss * ca.cos(gamma) - c.yb,
        tip_x - c.e * ca.sin(phi + delta) - c.zt * ca.cos(delta) - c.xa,
        tip_y + c.e * ca.cos(phi + delta) - c.zt * ca.sin(delta) - c.ya,
        tip_x - c.zf * ca.cos(omega + epsilon) - c.u * ca.sin(epsilon) - c.xa,
        tip_y - c.zf * ca.sin(omega + epsilon) + c.u * ca.cos(epsilon) - c.ya,
    )
    system = System(
        q, v, kinetic - c.c0 * stretch**2 / 2 + c.mom * beta, constraint=loops, params=c
    )
    return Model(
        name="andrews_mechanism",
        system=system,
        q0=ANDREWS_START,
        v0=np.zeros(7),
        duration=0.03,
        h=5e-5,
        claim="T + V − M β is kept; at t = 0.03 s the crank stands at β = 15.8107711951537.",
        source=(
            "Hairer & Wanner, Solving ODEs II, 2nd ed., VII.7; Schiehlen (ed.), Multibody Systems "
            "Handbook (1990)."
        ),
        invariants=energy(system),
    )
