"""Stiffly damped linear scenes that nothing drives: runs of millions of steps as powers of the map
of one.
"""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise

import casadi as ca
import mpmath as mp
import numpy as np
import pytest

import varint as vi
import varint.integration.steady_controls as steady_controls
from varint.discrete.linear_flow import flow, has_powers, powers, rates, rough_rates
from varint.integration.linear_run import MAPPED, TOLD
from varint.integration.settled_run import SHORT, settles_within
from varint.numerics.linear_maps import (
    exactly_moved,
    moved,
    spread,
)

TOLERANCES = 1e-3, 1e-6, 1e-9, 1e-12


def chain(k) -> np.ndarray:
    """Springs or dampers between neighbours, and at both ends."""
    return np.diag(np.add(k[:-1], k[1:])) - np.diag(k[1:-1], 1) - np.diag(k[1:-1], -1)


# masses, springs, dampers, constant forces, coupling L = q' B q, and a duration; entries are short
# binary numbers, so that what CasADi adds up of them is not rounded
SCENES = {
    "heat": (np.eye(5) * 2.0**-20, chain([1] * 6), np.eye(5) + chain([0.5] * 6), 0, 0, 10.0),
    "free": (
        np.eye(4) * 2.0**-20,
        chain([0, 1.5, 1, 2, 0]),
        chain([0, 2, 1, 4, 0]),
        0,
        0,
        10.0,
    ),
    "circuits": (
        np.eye(4) * 2.0**-20,
        np.diag([1.0, 2.0, 3.0, 4.0]) + 1,
        np.diag([1.0, 0.125, 0.03125, 2.0]) + 0.25,
        np.array([1.0, 0.0, 0.0, 0.0]),
        0,
        3.0,
    ),
    "light and heavy": (np.diag([1, 2.0**-27]), chain([1, 100, 0]), chain([0, 1, 0.5]), 0, 0, 5.0),
    "not proportional": (
        np.diag([1, 0.5, 2.0**-10, 2.0**-13])
        + np.diag([0.125, 0, 0], 1)
        + np.diag([0.125, 0, 0], -1),
        chain([4, 10000, 50, 3, 0]),
        np.array([[3.5, 1, 0, -0.5], [1, 2, 0.25, 0], [0, 0.25, 4, 1], [-0.5, 0, 1, 1.5]]),
        np.array([9.75, 4.875, 0.0095, 0.0012]),
        0,
        3.0,
    ),
    "drifting": (
        np.diag([1, 2.0**-21, 2]),
        chain([0, 1000, 7700, 0]),
        chain([0, 5, 1, 0]),
        0,
        0,
        10.0,
    ),
    "turning": (
        np.diag([1, 1, 2.0**-20]),
        chain([1, 10, 10, 0]),
        chain([0.125, 0.5, 1, 0]),
        0,
        np.array([[0.0, 2, 0], [0, 0, 0], [0, 0, 0]]),
        5.0,
    ),
    "a fast one that lives": (
        np.diag([1, 2.0**-20, 1]),
        np.diag([1, 1, 1e8]),
        np.diag([0.125, 1.0, 0]),
        0,
        0,
        10.0,
    ),
    "one that grows": (np.diag([1, 2.0**-20]), np.diag([-4, 1]), np.diag([0.125, 1]), 0, 0, 5.0),
}


def scene_of(name: str) -> tuple[vi.System, float]:
    mass, springs, dampers, push, turn, duration = SCENES[name]
    n = len(mass)
    q, v = vi.coordinates(*(f"a{i}" for i in range(n)))
    energy = ca.bilin(ca.DM(mass), v, v) / 2 - ca.bilin(ca.DM(springs), q, q) / 2
    energy += ca.dot(ca.DM(push * np.ones(n)), q) + ca.dot(v, ca.DM(turn * np.ones((n, n))) @ q)
    return vi.System(q, v, energy, force=-ca.DM(dampers) @ v), duration


def start_of(name: str) -> tuple[np.ndarray, np.ndarray]:
    i = np.arange(len(SCENES[name][0]))
    return np.cos(1.0 + i), np.sin(2.0 + i)


def exponential(a: mp.matrix) -> mp.matrix:
    """By Taylor's series and squaring, with as many digits more as squaring loses."""
    size = max(sum(abs(a[i, j]) for j in range(a.cols)) for i in range(a.rows))
    squares = max(0, int(mp.ceil(mp.log(size, 2)))) + 4
    with mp.workdps(50 + squares):
        part, found, term, k = a / mp.mpf(2) ** squares, mp.eye(a.rows), mp.eye(a.rows), 0
        while mp.norm(term, mp.inf) > mp.mpf(10) ** -mp.mp.dps:
            k += 1
            term = term * part / k
            found += term
        for _ in range(squares):
            found = found * found
    return found


def exact(name: str, times) -> tuple[np.ndarray, np.ndarray]:
    """q and v by the matrix exponential with 50 digits."""
    mass, springs, dampers, push, turn, _ = SCENES[name]
    n = len(mass)
    turn = turn * np.ones((n, n))
    with mp.workdps(60):
        a, inverse = mp.zeros(2 * n + 1), mp.matrix(mass.tolist()) ** -1
        a[:n, n : 2 * n] = mp.eye(n)
        a[n : 2 * n, :n] = -(inverse * mp.matrix(springs.tolist()))
        a[n : 2 * n, n : 2 * n] = -(inverse * mp.matrix((dampers + turn - turn.T).tolist()))
        a[n : 2 * n, 2 * n] = inverse * mp.matrix((push * np.ones(n)).tolist())
        x = mp.matrix([*np.concatenate(start_of(name)).tolist(), 1])
        found = [exponential(a * mp.mpf(time)) * x for time in times]
        both = np.array([[float(y) for y in state] for state in found])
    return both[:, :n], both[:, n : 2 * n]


def times_of(duration: float) -> np.ndarray:
    """Some in the first microseconds."""
    return np.array([1e-8, 3e-7, 1e-6, 1e-4, 0.1, duration / 2, duration])


@pytest.fixture(scope="module")
def known():
    """The exact motions, each found once."""
    found: dict = {}

    def motion(name):
        if name not in found:
            found[name] = exact(name, times_of(SCENES[name][-1]))
        return found[name]

    return motion


@pytest.mark.parametrize("name", SCENES)
def test_errors_are_below_the_tolerance_at_all_times(name, known):
    (scene, duration), (q0, v0) = scene_of(name), start_of(name)
    times, (q, v) = times_of(duration), known(name)
    for tol in TOLERANCES:
        motion = vi.simulate(scene, q0=q0, v0=v0, duration=duration, tol=tol)
        assert motion.stats["backend"] == TOLD and motion.stats["error_estimate"] <= tol
        assert len(motion) < 2**15 < motion.stats["steps"]
        found, size = motion.at(times), np.ptp(motion.q, axis=0).max()
        assert np.abs(found.q - q).max() <= min(motion.stats["error_estimate"], 2e-14) * size
        # the last digit of coordinates moves what is fast by as much, times how fast that is
        assert np.abs(found.v - v).max() <= 1e-11 * np.abs(v).max()
        asked = vi.simulate(scene, q0=q0, v0=v0, duration=duration, tol=tol, at=times)
        assert np.array_equal(asked.q, found.q) and np.array_equal(asked.p, found.p)
        assert np.array_equal(asked.t, times)


def beam(elements: int, damping: float) -> tuple[vi.System, np.ndarray, np.ndarray]:
    """A cantilever of cubic elements (Euler–Bernoulli) with damping proportional to stiffness, and
    its matrices, of whole numbers but for powers of two.
    """
    n = 2 * (elements + 1)
    stiffness, mass = np.zeros((n, n)), np.zeros((n, n))
    k = np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]])
    m = np.array([[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]])
    for i in range(0, 2 * elements, 2):
        stiffness[i : i + 4, i : i + 4] += k * 4096.0
        mass[i : i + 4, i : i + 4] += m / 4096
    stiffness, mass = stiffness[2:, 2:], mass[2:, 2:]
    q, v = vi.coordinates(*(f"w{i}" for i in range(n - 2)))
    energy = ca.bilin(ca.DM(mass), v, v) / 2 - ca.bilin(ca.DM(stiffness), q, q) / 2
    force = -ca.DM(damping * stiffness) @ v
    return vi.System(q, v, energy, force=force), mass, stiffness


def modes(mass, stiffness, damping, q0, times) -> np.ndarray:
    """Of a beam that is let go, by its modes with 40 digits."""
    with mp.workdps(40):
        low = mp.cholesky(mp.matrix(mass.tolist()))
        inverse = low**-1
        squares, turned = mp.eigsy(inverse * mp.matrix(stiffness.tolist()) * inverse.T)
        shapes = inverse.T * turned
        start = turned.T * low.T * mp.matrix(q0.tolist())
        found = []
        for t in times:
            each = mp.matrix(len(q0), 1)
            for i, square in enumerate(squares):
                half = damping * square / 2
                root = mp.sqrt(mp.mpc(half**2 - square))
                a, b = -half + root, -half - root
                each[i] = start[i] * mp.re((a * mp.exp(b * t) - b * mp.exp(a * t)) / (a - b))
            found.append([float(x) for x in shapes * each])
    return np.array(found)


@pytest.mark.parametrize("damping", [2.0**-14, 2.0**-10, 2.0**-3])
@pytest.mark.parametrize("elements", [5, 10])
def test_a_beam_swings_as_its_modes(elements, damping):
    scene, mass, stiffness = beam(elements, damping)
    tip = np.zeros(2 * elements)
    tip[-2] = 1.0
    q0, duration = np.linalg.solve(stiffness, tip), 40.0
    motion = vi.simulate(scene, q0=q0, v0=0 * q0, duration=duration, tol=1e-12)
    assert motion.stats["backend"] == TOLD
    times = np.array([1e-7, 1e-5, 1e-3, 0.1, 5.0, duration])
    found = motion.at(times).q
    assert found == pytest.approx(modes(mass, stiffness, damping, q0, times), abs=2e-14 * q0.max())
    energy = motion.energy
    assert (np.diff(energy) <= 4e-16 * energy[0]).all() and energy[-1] < energy[0]


def test_powers_come_where_one_map_cannot_be_repeated_so_often():
    scene, mass, stiffness = beam(10, 2.0**-10)
    tip = np.zeros(20)
    tip[-2] = 1.0
    q0, duration = np.linalg.solve(stiffness, tip), 0.012
    assert not settles_within(scene, np.empty(0), duration)
    assert settles_within(scene, np.empty(0), duration, SHORT)
    wanted = modes(mass, stiffness, 2.0**-10, q0, [duration])[0]
    for tol, powers_of_it in ((1e-4, False), (1e-10, True)):
        motion = vi.simulate(scene, q0=q0, v0=0 * q0, duration=duration, tol=tol)
        assert (motion.stats["backend"] == TOLD) is powers_of_it
        size = np.ptp(motion.q, axis=0).max()
        assert np.abs(motion.q[-1] - wanted).max() <= motion.stats["error_estimate"] * size


@pytest.mark.parametrize("name", ["not proportional", "turning", "free"])
def test_powers_are_the_steps_of_the_plain_loop(name):
    (scene, _), (q0, v0) = scene_of(name), start_of(name)
    h = 1.0 / flow(scene, scene.default_vector).norm
    motion = vi.simulate(scene, vi.gauss(8), q0=q0, v0=v0, h=h, steps=200)
    of = powers(scene, vi.gauss(8), motion.c, h)
    k = np.arange(201)
    begin = np.repeat(of.within(motion.q[:1], motion.p[:1]), 201, axis=0)
    size = [np.abs(x).max(axis=0) for x in (motion.q, motion.p)]
    for how in (moved, exactly_moved):
        q, p = of.states(how(of.up_to(8), begin, k))
        assert (np.abs(q - motion.q) <= 1e-13 * size[0].max()).all()
        assert (np.abs(p - motion.p) <= 1e-12 * size[1].max()).all()
    doubled = spread(of.up_to(6), begin[0])
    assert (
        np.abs(doubled - moved(of.up_to(6), begin, k)[:64]).max() <= 1e-14 * np.abs(doubled).max()
    )


def test_a_shift_of_a_free_chain_meets_no_force():
    # sums of such springs are rounded where derivatives are made: forces are not
    stiff = vi.Parameters(a=1.1, b=2.7, c=1e6 / 3, d=0.3)
    q, v = vi.coordinates("x1", "x2", "x3", "x4", "x5")
    each = ca.vertcat(stiff.a, stiff.b, stiff.c, stiff.d)
    springs = ca.dot(each, (q[1:] - q[:-1]) ** 2) / 2
    rub = each * (v[1:] - v[:-1]) / 7
    force = ca.vertcat(rub, 0) - ca.vertcat(0, rub)
    scene = vi.System(q, v, ca.sumsqr(v) / 2 - springs, force=force, params=stiff)
    found = flow(scene, scene.default_vector)
    shift = np.concatenate((np.ones(5), np.zeros(6))) / found.unit
    for high, low in zip(found.a.high.tolist(), found.a.low.tolist(), strict=True):
        row = [Fraction(x) + Fraction(y) for x, y in zip(high, low, strict=True)]
        size = max([abs(x * Fraction(s)) for x, s in zip(row, shift.tolist(), strict=True)])
        sums = sum(x * Fraction(s) for x, s in zip(row, shift.tolist(), strict=True))
        assert abs(sums) <= 1e-30 * size


@pytest.mark.parametrize("name", ["heat", "turning", "not proportional"])
def test_rates_are_no_less_than_those_of_the_motion(name):
    scene, _ = scene_of(name)
    mass, springs, dampers, _, turn, _ = SCENES[name]
    n, inverse = len(mass), np.linalg.inv(mass)
    turn = turn * np.ones((n, n))
    a = np.block(
        [[np.zeros((n, n)), np.eye(n)], [-inverse @ springs, -inverse @ (dampers + turn - turn.T)]]
    )
    fastest = np.abs(np.linalg.eigvals(a)).max()
    of = scene, scene.default_vector
    assert fastest <= 2 * rates(*of)[0] and rates(*of)[0] <= rough_rates(*of)[0] * (1 + 1e-12)
    assert rates(*of)[0] < 50 * fastest and fastest <= flow(*of).norm * (1 + 1e-12)


def test_nodes_are_found_again_from_others():
    (scene, duration), (q0, v0) = scene_of("circuits"), start_of("circuits")
    motion = vi.simulate(scene, q0=q0, v0=v0, duration=duration)
    part, some = motion[::500], np.arange(7, 16000, 311)
    found, size = part.at(motion.t[some]), np.abs(motion.q).max()
    assert np.array_equal(found.k, motion.k[some])
    assert found.q == pytest.approx(motion.q[some], abs=2e-15 * size)
    before = motion.at(motion.t[some], "before")
    assert before.q == pytest.approx(motion.q[some], abs=2e-15 * size)
    state = motion.at(float(motion.t[5] + 0.4 * motion.h))
    one = vi.simulate(scene, vi.gauss(8), q0=motion.q[5], p0=motion.p[5], h=0.4 * motion.h, steps=1)
    assert state.q == pytest.approx(one.q[-1], abs=1e-15 * size)


def test_kept_nodes_of_a_run_by_steps_lead_to_the_others():
    (scene, _), (q0, v0) = scene_of("not proportional"), start_of("not proportional")
    how = {"q0": q0, "v0": v0, "h": 1e-5, "steps": 1000}
    every, some = (vi.simulate(scene, vi.gauss(8), save_every=k, **how) for k in (1, 500))
    found = some.at(every.t)
    assert found.q == pytest.approx(every.q, abs=1e-13 * np.abs(every.q).max())
    assert np.array_equal(found.k, every.k)


def test_files_and_calls_have_the_same_bytes(tmp_path):
    (scene, duration), (q0, v0) = scene_of("free"), start_of("free")
    how = {"q0": q0, "v0": v0, "duration": duration}
    motion, again, other = (vi.simulate(s, **how) for s in (scene, scene, scene_of("free")[0]))
    motion.save(tmp_path / "free.npz")
    loaded = vi.load(tmp_path / "free.npz")
    times = np.geomspace(1e-9, duration, 40)
    for one in (again, other, loaded):
        for a, b in ((motion, one), (motion.at(times), one.at(times))):
            assert a.q.tobytes() == b.q.tobytes() and a.p.tobytes() == b.p.tobytes()
            assert a.t.tobytes() == b.t.tobytes() and a.k.tobytes() == b.k.tobytes()
    assert loaded.stats["steps"] == motion.stats["steps"]
    kept = vi.simulate(scene, checkpoint=tmp_path / "kept.npz", **how)
    read = vi.simulate(scene, checkpoint=tmp_path / "kept.npz", **how)
    assert kept.q.tobytes() == read.q.tobytes() == motion.q.tobytes()


def test_what_is_asked_besides_goes_the_longer_way_to_the_same():
    q, v = vi.coordinates("x", "y")
    springs = 2 * q[0] ** 2 + (q[1] - q[0]) ** 2
    energy = v[0] ** 2 / 2 + 2.0**-15 * v[1] ** 2 / 2 - springs
    scene = vi.System(q, v, energy, force=-0.5 * v)
    how = {"q0": [1.0, 0.5], "v0": [0.0, 0.0], "duration": 2.0, "tol": 1e-7}
    motion = vi.simulate(scene, **how)
    assert motion.stats["backend"] == TOLD
    for more in (
        {"backend": "interpreted"},
        {"save_every": 3},
        {"events": {"meet": q[0] - q[1]}},
        {"rule": vi.gauss(4)},
    ):
        other = vi.simulate(scene, **how, **more)
        assert other.stats["backend"] != TOLD
        assert motion.at(other.t).q == pytest.approx(other.q, abs=2e-7)
    by_momentum = vi.simulate(scene, **{**how, "v0": None}, p0=[0.0, 0.0])
    late = vi.simulate(scene, **how, t0=3.0)
    assert np.array_equal(by_momentum.q, motion.q) and np.array_equal(late.q, motion.q)
    assert np.array_equal(late.t, 3.0 + motion.t)
    scaled = vi.simulate(scene, **how, scale=1e-6)
    assert scaled.stats["error_estimate"] > motion.stats["error_estimate"]


def test_parameters_are_as_numbers():
    q, v = vi.coordinates("x", "y")
    c = vi.Parameters(light=0.5, rub=0.1, stiff=2.0)

    def scene_with(light, rub, stiff, **more):
        energy = (v[0] ** 2 + light * v[1] ** 2 - ca.sqrt(stiff) * (q[0] - q[1]) ** 2) / 2
        return vi.System(q, v, energy - q[0] ** 2 / 2, force=-rub * v, **more)

    numbers = {"light": 2.0**-18, "rub": 0.75, "stiff": 9.0}
    how = {"q0": [1.0, 0.5], "v0": [0.0, 1.0], "duration": 4.0}
    some = scene_with(c.light, c.rub, c.stiff, params=c)
    calm = vi.simulate(some, **how)
    found = vi.simulate(some, **how, params=numbers)
    fixed = vi.simulate(scene_with(**numbers), **how)
    assert calm.stats["backend"] != TOLD and found.stats["backend"] == TOLD
    assert np.array_equal(found.q, fixed.q)
    again = vi.simulate(some, **how)
    assert np.array_equal(again.q, calm.q) and again.stats["backend"] != TOLD


def test_controls_that_stay_the_same_are_as_numbers(monkeypatch):
    q, v = vi.coordinates("x", "y")
    u = ca.SX.sym("u")
    energy = (2.0**-13 * v[0] ** 2 + v[1] ** 2 - q[0] ** 2 - (q[1] - q[0]) ** 2) / 2

    def scene_with(push, **more):
        return vi.System(q, v, energy, force=ca.vertcat(push - v[0], -0.125 * v[1]), **more)

    how = {"q0": [1.0, 0.0], "v0": [0.0, 0.0], "duration": 5.0, "tol": 1e-7}
    driven = vi.simulate(scene_with(u, control=u), u=0.5, **how)
    fixed = vi.simulate(scene_with(0.5), **how)
    assert driven.stats["backend"] == fixed.stats["backend"] == TOLD
    assert np.array_equal(driven.q, fixed.q) and (driven.u == 0.5).all()
    times = np.array([1e-6, 1e-5, 1e-3, 2.3])
    assert driven.at(times).q == pytest.approx(fixed.at(times).q, abs=1e-12)
    monkeypatch.setattr(steady_controls, "MOST_STEPS", 2**14)  # no controls for each of more
    other = vi.simulate(scene_with(u, control=u), u=0.5, **how)
    assert other.stats["backend"] != TOLD and len(other.u) == len(other) - 1
    assert other.q[-1] == pytest.approx(driven.q[-1], abs=1e-7)


def test_what_hardly_damps_takes_its_own_steps():
    q, v = vi.coordinates("x")
    c, t = np.empty(0), vi.time()
    for rub, duration, settles in ((0.1, 1e3, False), (0.01, 2e5, False), (1e5, 1.0, True)):
        scene = vi.System(q, v, (v**2 - q**2) / 2, force=-rub * v)
        assert settles_within(scene, c, duration) is settles
    for scene in (
        vi.System(q, v, (v**2 - 1e12 * q**2) / 2),  # keeps its energy
        vi.System(q, v, (v**2 - q**2) / 2, force=-1e6 * v**3),
        vi.System(q, v, (v**2 - q**2) / 2, force=-1e6 * v + ca.sin(t), t=t),
    ):
        assert not settles_within(scene, c, 1.0)
    assert not has_powers(scene, MAPPED)


def test_backwards_a_damped_motion_grows_and_is_no_power():
    q, v = vi.coordinates("x")
    scene = vi.System(q, v, (v**2 - q**2) / 2, force=-1e6 * v)
    back = vi.simulate(scene, q0=1.0, v0=1.0, duration=-1e-5)
    assert back.stats["backend"] != TOLD
    with pytest.raises(vi.VarintError):
        vi.simulate(scene, q0=1.0, v0=1.0, duration=-1.0)


def test_gradients_are_those_of_the_exponential():
    q, v = vi.coordinates("x")
    scene = vi.System(q, v, (v**2 - q**2) / 2, force=-20000.0 * v)
    motion = vi.simulate(scene, q0=1.0, v0=0.5, duration=1.0)
    assert motion.stats["backend"] == TOLD
    slopes = vi.gradient(motion, terminal_loss=q)
    half, root = 10000.0, np.sqrt(1e8 - 1.0)
    slow, fast = -1.0 / (half + root), -half - root
    by_q = (-fast * np.exp(slow) + slow * np.exp(fast)) / (slow - fast)
    by_v = (np.exp(slow) - np.exp(fast)) / (slow - fast)
    assert float(slopes.q0[0]) == pytest.approx(by_q, rel=1e-9)
    assert float(slopes.v0[0]) == pytest.approx(by_v, rel=1e-9)


def test_sizes_of_nodes_do_not_hide_what_is_over_before_the_first():
    # from rest at zero a blow moves it, which dampers end before the first node
    q, v = vi.coordinates("x")
    scene = vi.System(q, v, (v**2 - 1e6 * q**2) / 2, force=-1e4 * v)
    motion = vi.simulate(scene, q0=0.0, v0=1.0, duration=1e5, tol=1e-9)
    half, root = 5e3, np.sqrt(2.5e7 - 1e6)
    times = np.array([1e-6, 1e-4, 1e-3, 1e-2])
    both = np.exp(np.outer(times, [root - half, -root - half])) @ [0.5 / root, -0.5 / root]
    assert motion.stats["error_estimate"] <= 1e-9
    assert motion.at(times).q[:, 0] == pytest.approx(both, abs=1e-9 * both.max())


def test_many_steps_are_one_map():
    # of (R − 1) by squaring, R itself: what lasts keeps its digits over 2³⁰ steps
    q, v = vi.coordinates("x")
    scene = vi.System(q, v, v**2 / 2 - q**2 / 2, force=-v)
    h = 2.0**-30
    of = powers(scene, vi.gauss(8), np.empty(0), h)
    x = of.within(np.ones((1, 1)), np.zeros((1, 1)))
    for j in (0, 10, 20, 30):
        t = h * 2.0**j
        found = of.states(moved(of.up_to(31), x, np.array([2**j])))[0][0, 0]
        w = np.sqrt(0.75)
        wanted = np.exp(-t / 2) * (np.cos(w * t) + np.sin(w * t) * 0.5 / w)
        assert found == pytest.approx(wanted, rel=4e-16)
    for one, two in pairwise(of.up_to(31)):
        assert two.high == pytest.approx(2 * one.high + one.high @ one.high, abs=1e-15)


def test_steps_that_were_not_kept_are_not_taken_again_for_hours():
    q, v = vi.coordinates("x")
    system = vi.System(q, v, v**2 / 2 - q**2 / 2, force=-(2.0**12) * v)
    motion = vi.simulate(system, q0=1.0, v0=0.0, duration=1e6)
    assert motion.k[-1] - len(motion) > 10**8
    for name, work in {
        "the action": lambda: motion.action,
        "derivatives": motion.transition_matrix,
    }.items():
        with pytest.raises(vi.InputError, match=f"steps of this run were not kept, and .*{name}"):
            work()
