"""Bounds of expressions along pieces of a motion hold what they promise, and are not idle."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.integration.events.enclosures import (
    Pieces,
    enclosure,
    enclosure_function,
    lower_bound,
)

(Q, V), T = vi.coordinates("x", "y"), vi.time()
SYSTEM = vi.System(Q, V, ca.sumsqr(V) / 2, t=T)
X, Y = Q[0], Q[1]
EXPRESSIONS = [
    X * Y - X / (3 + Y),
    X**2 - Y**3 + X**4,
    ca.norm_2(Q),
    ca.sin(3 * X) + ca.cos(X * Y),
    ca.tan(X / 2),
    ca.exp(X) - ca.log(3 + Y),
    ca.atan2(Y, X),
    ca.atan(X) + ca.tanh(Y),
    ca.asin(X / 5) + ca.acos(Y / 5),
    ca.sinh(X) - ca.cosh(Y),
    ca.fabs(X) - ca.fabs(Y - 0.1),
    ca.fmin(X, Y) + ca.fmax(X, 2 * Y),
    ca.if_else(X > 0.2, Y, -Y),
    ca.sign(X) + ca.floor(3 * Y),
    (3 + X) ** 1.7,
    ca.hypot(X, Y) + ca.log1p(ca.fabs(X)),
    X - ca.sin(5 * T),
    V[0] * X + V[1] ** 2,
]


def pieces_of(rng, count):
    """Pieces of parabolas, whose cubics are exact, forwards and backwards in time."""
    q0, v0, a = rng.uniform(-1.5, 1.5, (3, count, 2))
    w = rng.choice([-1, 1], count) * 10 ** rng.uniform(-3, 0, count)
    way = w[:, None]
    pieces = Pieces(q0, v0, q0 + way * v0 + way**2 * a / 2, v0 + way * a, rng.normal(size=count), w)
    return pieces, a


@pytest.mark.parametrize("expression", EXPRESSIONS, ids=str)
def test_values_and_rates_along_a_piece_lie_within_their_enclosures(expression):
    pieces, a = pieces_of(np.random.default_rng(5), 200)
    e = enclosure(
        enclosure_function(SYSTEM, expression), pieces, np.zeros(0), np.zeros(SYSTEM.c.numel())
    )
    value = ca.Function("value", [Q, V, T], [expression])
    s = np.linspace(0, 1, 41)
    values = np.empty((len(s), 200))
    for i, x in enumerate(s):
        t = (x * pieces.w)[:, None]
        q, v = pieces.q0 + t * pieces.v0 + t**2 * a / 2, pieces.v0 + t * a
        values[i] = np.array(value(q.T, v.T, (pieces.t + t[:, 0])[None])).ravel()
    small = 1e-9 * (1 + np.abs(values).max(axis=0))
    assert (values >= e.low[:, 0] - small).all() and (values <= e.high[:, 0] + small).all()
    rates = np.diff(values, axis=0) / (pieces.w / (len(s) - 1))
    slack = 1e-6 * (1 + np.abs(rates).max(axis=0))
    assert (rates >= e.rate_low[:, 0] - slack).all() and (rates <= e.rate_high[:, 0] + slack).all()
    ends = values[0][:, None], values[-1][:, None], np.full((200, 1), np.nan), np.nan
    least = lower_bound(ends, pieces.w[:, None], e)[:, 0]
    assert (values >= least - small).all()
    short = np.abs(pieces.w) < 0.01
    tight = values.min(axis=0) - least <= 0.1  # most pieces are far from kinks and poles
    assert tight[short].mean() > 0.9


def test_a_parabola_is_bounded_by_itself_where_its_rates_are_known():
    rng = np.random.default_rng(6)
    pieces, a = pieces_of(rng, 300)
    e = enclosure(enclosure_function(SYSTEM, Y), pieces, np.zeros(0), np.zeros(SYSTEM.c.numel()))
    ends = tuple(x[:, 1:] for x in (pieces.q0, pieces.q1, pieces.v0, pieces.v1))
    least = lower_bound(ends, pieces.w[:, None], e)[:, 0]
    turn = -pieces.v0[:, 1] / a[:, 1] / pieces.w
    lowest = np.minimum(pieces.q0[:, 1], pieces.q1[:, 1])
    inside = (turn > 0) & (turn < 1)
    bottom = pieces.q0[:, 1] - pieces.v0[:, 1] ** 2 / (2 * a[:, 1])
    lowest = np.where(inside, np.minimum(lowest, bottom), lowest)
    np.testing.assert_allclose(least, lowest, rtol=0, atol=1e-7)
    assert inside.sum() > 5
