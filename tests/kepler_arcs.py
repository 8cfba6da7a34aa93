"""Arcs of Kepler's orbits: exact ones, and first paths of them as somebody would draw them."""

from itertools import pairwise

import casadi as ca
import numpy as np
from scipy.optimize import brentq, minimize_scalar

import varint as vi


def kepler(mu=1.0, names="xy"):
    q, v = vi.coordinates(*names)
    return vi.System(q, v, ca.sumsqr(v) / 2 + mu / ca.norm_2(q))


def lambert(start, end, duration, forwards, turns, mu=1.0):
    """Velocities at the start of all Kepler arcs in the plane (Bate, Mueller & White, §5.3)."""
    first, last = np.linalg.norm(start), np.linalg.norm(end)
    angle = np.arccos(start @ end / (first * last))
    if (start[0] * end[1] - start[1] * end[0] < 0) == forwards:
        angle = 2 * np.pi - angle
    a = np.sin(angle) * np.sqrt(first * last / (1 - np.cos(angle)))

    def y_and_time(psi):
        root = np.sqrt(psi)
        c, s = (1 - np.cos(root)) / psi, (root - np.sin(root)) / root**3
        y = first + last + a * (psi * s - 1) / np.sqrt(c)
        return y, ((y / c) ** 1.5 * s + a * np.sqrt(y)) / np.sqrt(mu) if y > 0 else -1.0

    low, high = (2 * np.pi * turns) ** 2, (2 * np.pi * (turns + 1)) ** 2
    low, high = max(low * (1 + 1e-6), 1e-6), high * (1 - 1e-6)
    ends = [low, high]
    if turns:
        shortest = minimize_scalar(
            lambda psi: y_and_time(psi)[1], bounds=(low, high), options=dict(xatol=1e-9)
        )
        ends.insert(1, shortest.x)
    velocities = []
    for left, right in pairwise(ends):
        psi = brentq(lambda x: y_and_time(x)[1] - duration, left, right, xtol=1e-15, rtol=1e-15)
        y = y_and_time(psi)[0]
        velocities.append((end - (1 - y / first) * start) / (a * np.sqrt(y / mu)))
    return velocities


def conic(start, end, parameter, forwards, turns, nodes=2000):
    """The ellipse of this parameter about the origin through both ends, at equal times, and how
    long it takes.
    """
    sizes = np.array([np.linalg.norm(start), np.linalg.norm(end)])
    apse = np.linalg.solve(np.array([start, end]), parameter - sizes)
    e, direction, sign = np.linalg.norm(apse), np.arctan2(apse[1], apse[0]), 1 if forwards else -1
    if e >= 1:
        return None, np.inf
    a = parameter / (1 - e**2)

    def mean(point):
        true = (np.arctan2(point[1], point[0]) - direction) * sign
        eccentric = 2 * np.arctan2(
            np.sqrt(1 - e) * np.sin(true / 2), np.sqrt(1 + e) * np.cos(true / 2)
        )
        return eccentric - e * np.sin(eccentric)

    whole = (mean(end) - mean(start)) % (2 * np.pi) + 2 * np.pi * turns
    at = mean(start) + np.linspace(0, whole, nodes)
    eccentric = at + e * np.sin(at)
    for _ in range(60):
        eccentric -= 0.7 * (eccentric - e * np.sin(eccentric) - at) / (1 - e * np.cos(eccentric))
    x, y = a * (np.cos(eccentric) - e), sign * a * np.sqrt(1 - e**2) * np.sin(eccentric)
    c, s = np.cos(direction), np.sin(direction)
    return np.stack([c * x - s * y, s * x + c * y], axis=1), whole * a**1.5


def ellipse_of_about_the_period(start, end, v, duration, forwards, share):
    """An ellipse through both ends that takes `share` of the duration, near the one with v."""
    own = (start[0] * v[1] - start[1] * v[0]) ** 2
    trials = own * np.linspace(0.9, 1.1, 201)
    times = [conic(start, end, p, forwards, 1, 3)[1] for p in trials]
    best = np.argmin(np.abs(np.array(times) / duration - share))
    return conic(start, end, trials[best], forwards, 1)[0]


def eccentric_ends(e, first, last):
    """Two places on an ellipse of axis 1 and the time between them with a turn more."""
    places, means = [], []
    for true in (first, last):
        r = (1 - e**2) / (1 + e * np.cos(true))
        places.append(r * np.array([np.cos(true), np.sin(true)]))
        half = np.sqrt(1 - e) * np.sin(true / 2), np.sqrt(1 + e) * np.cos(true / 2)
        eccentric = 2 * np.arctan2(*half)
        means.append(eccentric - e * np.sin(eccentric))
    return *places, (means[1] - means[0]) % (2 * np.pi) + 2 * np.pi


def orbit(e, axis, forwards, mean):
    """Places on an ellipse of major half axis 1 about the origin at mean anomalies."""
    mean = np.atleast_1d(mean)
    eccentric = mean + e * np.sin(mean)
    for _ in range(200):
        change = (eccentric - e * np.sin(eccentric) - mean) / (1 - e * np.cos(eccentric))
        eccentric = eccentric - np.clip(change, -0.5, 0.5)
    sign = 1 if forwards else -1
    x, y = np.cos(eccentric) - e, sign * np.sqrt(1 - e**2) * np.sin(eccentric)
    c, s = np.cos(axis), np.sin(axis)
    return np.stack([c * x - s * y, s * x + c * y], axis=1)


def swept(places):
    """The angle that a path sweeps about the origin."""
    angle = np.unwrap(np.arctan2(places[:, 1], places[:, 0]))
    return angle[-1] - angle[0]


def random_arc(seed, least, most, turns):
    """Ends, duration and swept angle of an arc with so many turns, direction and axis by chance."""
    random = np.random.default_rng(seed)
    e, axis = random.uniform(least, most), random.uniform(0, 2 * np.pi)
    first, share = random.uniform(0, 2 * np.pi), random.uniform(0.1, 0.9)
    forwards = bool(random.integers(2))
    duration = 2 * np.pi * (share + turns)
    start, end = orbit(e, axis, forwards, [first, first + duration])
    mean = first + duration * np.linspace(0, 1, 4001)
    eccentric = np.interp(mean, *_kepler_table(e))
    places = np.stack([np.cos(eccentric) - e, np.sqrt(1 - e**2) * np.sin(eccentric)], axis=1)
    return start, end, duration, swept(places) * (1 if forwards else -1)


def _kepler_table(e):
    eccentric = np.linspace(-1, 30, 100_000)
    return eccentric - e * np.sin(eccentric), eccentric


def circling(start, end, angle, nodes=300):
    """A first path that sweeps this angle evenly, its distance changing evenly."""
    s = np.linspace(0, 1, nodes)
    r = np.linalg.norm(start) * (1 - s) + np.linalg.norm(end) * s
    at = np.arctan2(start[1], start[0]) + angle * s
    return np.stack([r * np.cos(at), r * np.sin(at)], axis=1)
