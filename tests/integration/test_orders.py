"""Every rule converges with its order in q and in p, and so does its dense output."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest
from scenes import (
    COMPOSITIONS,
    GALERKIN,
    double_pendulum,
    driven_damped,
    end_error,
    henon_heiles,
    pendulum,
    slopes,
)

import varint as vi

FLOOR = 1e-13
TOLERANCE = 0.15
# scene, start, duration, and the coarsest number of steps inside the asymptotic range by order
SCENES = {
    "pendulum": (pendulum, [2.0], [0.3], 8.0, {2: 80, 4: 40, 6: 32, 8: 25}),
    "double pendulum": (
        double_pendulum,
        [0.5, -0.3],
        [0.2, 0.1],
        2.0,
        {2: 120, 4: 60, 6: 40, 8: 62},
    ),
    "Hénon–Heiles": (henon_heiles, [0.1, 0.2], [0.4, 0.1], 8.0, {2: 80, 4: 24, 6: 20, 8: 13}),
    "driven and damped": (
        driven_damped,
        [0.9, 0.3],
        [1.2, 2.5],
        6.0,
        {2: 150, 4: 80, 6: 60, 8: 70},
    ),
}
# compositions take larger errors per step: their asymptotic range begins later
LATER = {
    "yoshida4": 4,
    "yoshida6": 2,
    "yoshida8": 4,
    "suzuki4": 3,
    "kahan-li6": 2,
    "kahan-li8": 1,
    "blanes-moan4": 3,
}


def _cases():
    for scene, (build, *_) in SCENES.items():
        rules = [r for r in GALERKIN if r.order <= 8]
        if build().structure.explicit:
            rules += [r for r in COMPOSITIONS if r.order <= 8]
        yield from ((scene, rule) for rule in rules)


def _later(rule) -> int:
    return next((factor for name, factor in LATER.items() if name in rule.name), 1)


@pytest.mark.parametrize(("scene", "rule"), list(_cases()), ids=str)
def test_the_order_of_q_and_p_is_the_rules(scene, rule):
    build, q0, v0, duration, coarsest = SCENES[scene]
    system = build()
    exact = vi.simulate(system, vi.gauss(10), q0=q0, v0=v0, duration=duration, steps=200)
    steps = [round(coarsest[rule.order] * _later(rule) * 1.25**i) for i in range(5)]
    errors = np.array(
        [
            end_error(vi.simulate(system, rule, q0=q0, v0=v0, duration=duration, steps=n), exact)
            for n in steps
        ]
    )
    np.testing.assert_allclose(slopes(steps, errors, FLOOR), rule.order, atol=TOLERANCE)


@pytest.mark.parametrize(
    "rule", [vi.midpoint(), vi.gauss(2), vi.gauss(3), vi.lobatto(3), vi.lobatto(4)], ids=str
)
def test_dense_output_has_the_order_of_the_rule(rule):
    build, q0, v0, duration, coarsest = SCENES["double pendulum"]
    system = build()
    times = np.linspace(0, duration, 18)[1:] - 0.0123
    exact = vi.simulate(system, vi.gauss(10), q0=q0, v0=v0, duration=duration, steps=200).at(times)
    steps = [round(coarsest[rule.order] * 1.4**i) for i in range(4)]
    errors = []
    for n in steps:
        dense = vi.simulate(system, rule, q0=q0, v0=v0, duration=duration, steps=n).at(times)
        errors.append(
            [np.sqrt(((dense.q - exact.q) ** 2).mean()), np.sqrt(((dense.p - exact.p) ** 2).mean())]
        )
    np.testing.assert_allclose(slopes(steps, np.array(errors), FLOOR), rule.order, atol=TOLERANCE)


def test_the_action_of_the_discrete_path_converges_with_the_order():
    build, q0, v0, duration, coarsest = SCENES["double pendulum"]
    system = build()
    exact = vi.simulate(system, vi.gauss(10), q0=q0, v0=v0, duration=duration, steps=100).action
    for rule in (vi.midpoint(), vi.gauss(2), vi.lobatto(3)):
        steps = [round(coarsest[rule.order] * 1.4**i) for i in range(4)]
        runs = [vi.simulate(system, rule, q0=q0, v0=v0, duration=duration, steps=n) for n in steps]
        errors = np.array([[abs(run.action - exact)] for run in runs])
        np.testing.assert_allclose(slopes(steps, errors, FLOOR), rule.order, atol=TOLERANCE)


# Above order 8 double precision leaves no asymptotic range. There an independent implementation
# with 130 digits shows the order, and the product must agree with it step by step to round-off at
# large steps.


def _tables(family: str, stages: int):
    """c, and the matrix B of Q = q + c h p + h² B F for the pendulum's second-order form, from
    mpmath alone.
    """
    degree = stages if family == "gauss" else stages - 1
    legendre = mp.taylor(lambda x: mp.legendre(degree, x), 0, degree)
    if family == "lobatto":
        legendre = [k * a for k, a in enumerate(legendre)][1:]
    near = np.polynomial.Polynomial([float(a) for a in legendre]).roots().real
    roots = [
        mp.findroot(lambda x: sum(a * x**k for k, a in enumerate(legendre)), mp.mpf(x))
        for x in near
    ]
    if family == "lobatto":
        roots = [mp.mpf(-1), *roots, mp.mpf(1)]
    c = sorted((1 + x) / 2 for x in roots)
    powers = mp.matrix([[x**k for k in range(stages)] for x in c])
    lagrange = powers**-1  # column j: coefficients of ℓ_j
    a = mp.matrix(
        [
            [
                sum(lagrange[k, j] * x ** (k + 1) / (k + 1) for k in range(stages))
                for j in range(stages)
            ]
            for x in c
        ]
    )
    b = [sum(lagrange[k, j] / (k + 1) for k in range(stages)) for j in range(stages)]
    dual = a
    if family == "lobatto":  # Lobatto IIIB, the symplectic partner of IIIA
        dual = mp.matrix(
            [[b[j] * (1 - a[j, i] / b[i]) for j in range(stages)] for i in range(stages)]
        )
    return c, b, a * dual


def _precise_step(tables, q, p, h):
    c, b, matrix = tables
    s = len(c)
    force = [-mp.sin(q + x * h * p) for x in c]
    for _ in range(400):
        stages = [
            q + c[i] * h * p + h**2 * sum(matrix[i, j] * force[j] for j in range(s))
            for i in range(s)
        ]
        new = [-mp.sin(x) for x in stages]
        change = max(abs(x - y) for x, y in zip(new, force, strict=True))
        force = new
        if change < mp.mpf(10) ** (-mp.mp.dps + 8):
            break
    weights = [
        sum(b[i] * (1 - c[i]) * force[i] for i in range(s)),
        sum(b[i] * force[i] for i in range(s)),
    ]
    return q + h * p + h**2 * weights[0], p + h * weights[1]


@pytest.mark.parametrize(
    ("family", "stages"),
    [("gauss", s) for s in range(5, 11)] + [("lobatto", s) for s in range(6, 11)],
)
def test_high_orders_hold_in_extended_precision_and_the_product_agrees_to_round_off(family, stages):
    rule = {"gauss": vi.gauss, "lobatto": vi.lobatto}[family](stages)
    with mp.workdps(130):
        tables = _tables(family, stages)
        defects = []
        # one step against two halves: the local error's leading term
        for h in (
            mp.mpf(1) / 1000,
            mp.mpf(1) / 1600,
        ):
            one = _precise_step(tables, mp.mpf("0.7"), mp.mpf("1.1"), h)
            half = _precise_step(tables, mp.mpf("0.7"), mp.mpf("1.1"), h / 2)
            two = _precise_step(tables, *half, h / 2)
            defects.append([abs(one[0] - two[0]), abs(one[1] - two[1])])
        orders = [
            float(mp.log(x / y) / mp.log(mp.mpf(8) / 5)) - 1 for x, y in zip(*defects, strict=True)
        ]
        np.testing.assert_allclose(orders, rule.order, atol=TOLERANCE)
        coarse = [float(x) for x in _precise_step(tables, mp.mpf(0.7), mp.mpf(1.1), mp.mpf(1))]
    for backend, close in (("interpreted", 2e-15), ("auto", 1e-14)):
        step = vi.simulate(pendulum(), rule, q0=0.7, p0=1.1, h=1.0, steps=1, backend=backend)
        np.testing.assert_allclose([step.q[-1, 0], step.p[-1, 0]], coarse, rtol=0, atol=close)
