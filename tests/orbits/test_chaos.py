"""Exponents and indicators from the tangent map of the run itself: pairs to round-off, closed
forms, literature, and what forces do to volumes.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from references import entries

import varint as vi

EXPONENTS = entries("orbits")["Lyapunov exponents"]["reference"]
RUNNING = entries("orbits")["double pendulum, running"]["reference"]
RELEASED = entries("orbits")["double pendulum, chaotic"]


def henon_heiles(y: float, total: float, steps: int, h: float = 0.25, **options) -> vi.Trajectory:
    model = vi.models.henon_heiles(q0=(0.0, y), total=total)
    start = dict(q0=model.q0, v0=model.v0, h=h, steps=steps)
    return vi.simulate(model.system, vi.gauss(6), **start, **options)


def driven_duffing() -> tuple[vi.System, vi.Parameters]:
    """x'' + γ x' − x + x³ = f cos t."""
    q, v, t = *vi.coordinates("x"), vi.time()
    c = vi.Parameters(gamma=0.25, f=0.4)
    force = -c.gamma * v + c.f * ca.cos(t)
    return vi.System(q, v, v**2 / 2 + q**2 / 2 - q**4 / 4, force=force, params=c, t=t), c


def spherical_double_pendulum() -> vi.System:
    """Two rods in space, in Cartesian coordinates with constraints."""
    q, v = vi.coordinates("x1", "y1", "z1", "x2", "y2", "z2")
    rods = ca.vertcat(ca.sumsqr(q[:3]) - 1, ca.sumsqr(q[3:] - q[:3]) - 1)
    return vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * (q[2] + q[5]), constraint=rods)


@pytest.mark.parametrize("rule", [vi.gauss(4), vi.trapezoidal(), vi.composition("blanes-moan4")])
def test_the_tangent_lift_carries_the_derivative_of_the_run_by_the_same_rule(rule):
    model = vi.models.henon_heiles(q0=(0.0, -0.25), total=1 / 8)
    lift = vi.orbits.tangent_lift(model.system)
    start = np.array([0.3, -0.2, 0.5, 0.1])
    both = vi.simulate(
        lift, rule, q0=[*model.q0, *start[:2]], v0=[*model.v0, *start[2:]], h=0.1, steps=200
    )
    alone = vi.simulate(model.system, rule, q0=model.q0, v0=model.v0, h=0.1, steps=200)
    wanted = vi.sensitivity(alone, ["q0", "v0"])[-1] @ start
    assert np.allclose(both.q[-1, :2], alone.q[-1], atol=1e-13)
    assert np.allclose(both.q[-1, 2:], wanted[:2], rtol=1e-10)
    assert np.allclose(both.p[-1, :2], wanted[2:], rtol=1e-10)  # δp = δv here


def test_the_lift_of_a_forced_scene_is_tangent_too():
    system, _ = driven_duffing()
    both = vi.simulate(
        vi.orbits.tangent_lift(system), vi.gauss(4), q0=[1, 0.2], v0=[0, 1], h=0.1, steps=100
    )
    alone = vi.simulate(system, vi.gauss(4), q0=1.0, v0=0.0, h=0.1, steps=100)
    wanted = vi.sensitivity(alone, ["q0", "v0"])[-1] @ [0.2, 1]
    assert np.allclose([both.q[-1, 1], both.v[-1, 1]], wanted, rtol=1e-11)


@pytest.mark.parametrize("rule", [vi.lobatto(2), vi.lobatto(3)])  # RATTLE first
def test_the_lift_of_a_constrained_scene_is_tangent_by_the_rules_of_the_scene(rule):
    q0, v0 = np.array([0.6, 0, -0.8, 1.2, 0.0, -1.6]), np.array([0, 1.0, 0, 0, 0.5, 0])
    pendulum = spherical_double_pendulum()
    turn = np.concatenate([np.cross([0.3, 1, 0.2], x) for x in (q0[:3], q0[3:])])
    rate = np.concatenate([np.cross([0.3, 1, 0.2], x) for x in (v0[:3], v0[3:])])
    lift = vi.orbits.tangent_lift(pendulum)
    both = vi.simulate(lift, rule, q0=[*q0, *turn], v0=[*v0, *rate], h=0.02, steps=50)
    alone = vi.simulate(pendulum, rule, q0=q0, v0=v0, h=0.02, steps=50)
    wanted = vi.sensitivity(alone, ["q0", "v0"])[-1] @ [*turn, *rate]
    assert np.allclose(both.q[-1, 6:], wanted[:6], atol=1e-10)
    assert np.abs(wanted).max() > 0.1


def published(steps: int, save_every: int = 1) -> tuple[vi.Trajectory, float]:
    """A motion of Hénon and Heiles from the printed start, and its printed exponent."""
    row, system = EXPONENTS["Hénon–Heiles"], vi.models.henon_heiles().system
    start = dict(q0=row["q0"], v0=row["v0"], h=0.25, steps=steps)
    motion = vi.simulate(system, vi.gauss(6), **start, save_every=save_every)
    return motion, row["exponent"]


def test_exponents_of_henon_heiles_are_those_of_the_literature_and_pair_to_round_off():
    motion, printed = published(40_000)
    found = vi.orbits.lyapunov_spectrum(motion)
    error = 3 * found.errors[0]
    assert abs(found.exponents[0] - printed) < error < 0.5 * found.exponents[0]
    assert found.pairing < 1e-12 and abs(found.sum) < 1e-12
    assert abs(found.exponents[1]) < 3 * np.log(motion.t[-1]) / motion.t[-1]
    chaotic = vi.orbits.megno(motion)
    assert np.isclose(chaotic.exponent, found.exponents[0], rtol=0.05)
    assert np.isclose(chaotic.value, chaotic.exponent * motion.t[-1] / 2, rtol=0.4)


@pytest.mark.long
def test_exponent_of_a_long_run_of_henon_heiles_is_that_of_the_literature():
    """A million units of time: stickiness at islands makes errors shrink slowly, 4e-3, 2e-3, 1e-3
    with every ten times longer run.
    """
    motion, printed = published(4_000_000, save_every=1000)
    found = vi.orbits.lyapunov_spectrum(motion, 1)
    assert abs(found.exponents[0] - printed) < 2 * found.errors[0] < 0.07 * printed
    assert np.ptp(motion.energy) < 1e-13


@pytest.fixture(scope="module")
def arms() -> vi.System:
    """The double pendulum with masses, arms and g of one."""
    q, v = vi.coordinates("a", "b")
    energy = v[0] ** 2 + v[1] ** 2 / 2 + v[0] * v[1] * ca.cos(q[0] - q[1])
    return vi.System(q, v, energy + 2 * ca.cos(q[0]) + ca.cos(q[1]))


@pytest.mark.parametrize("energy", RUNNING)
def test_running_motions_of_the_double_pendulum_grow_as_they_are_proved_to(arms, energy):
    """A turn multiplies by μ with μ + 1/μ = tr: its exponent ln |μ| / T, enclosed to 1e-5."""
    row, total = RUNNING[energy], float(energy)
    b, turn = np.mean(row["p"]), np.mean(row["period"])
    a = b + np.sqrt(6 + 2 * total - b**2)
    start = dict(q0=[0, 0], v0=[a - b, 2 * b - a])
    motion = vi.simulate(arms, vi.gauss(8), **start, duration=turn, steps=60)
    assert motion.energy[0] == pytest.approx(total, abs=1e-14)
    late = np.ptp(row["period"]) * np.abs(motion.v[-1]).max()
    assert np.abs(motion.q[-1] - [0, -2 * np.pi]).max() < late < 3e-8
    assert np.abs(motion.p[-1] - [a, b]).max() < 1e-9
    low, high = row["trace"]
    trace = np.trace(motion.transition_matrix()) - 2  # two multipliers are 1
    assert low < trace < high
    small, found, large = (
        np.log(np.abs(np.roots([1, -x, 1])).max()) / turn for x in (high, trace, low)
    )
    assert small < found < large < small + 1e-5


def released(steps: int) -> vi.Trajectory:
    """The double pendulum of the published exponents, from its start."""
    model = vi.models.double_pendulum(**RELEASED["params"])
    start = dict(q0=model.q0, v0=model.v0, h=0.01, steps=steps)
    return vi.simulate(model.system, vi.gauss(6), **start, save_every=100)


def within(found: vi.orbits.LyapunovSpectrum, errors: float) -> bool:
    """Whether all exponents are the published ones, by so many standard errors of both."""
    row = RELEASED["reference"]
    apart = np.abs(found.exponents - row["exponents"])
    return bool((apart < errors * np.hypot(row["errors"], found.errors)).all())


def test_exponents_of_a_chaotic_double_pendulum_are_the_published_ones():
    """A run as long as the published one, and one whose own error is a quarter of that printed:
    apart by less than the error printed alone.
    """
    short, long = (vi.orbits.lyapunov_spectrum(released(steps)) for steps in (20_000, 400_000))
    assert within(short, 3) and within(long, 3)
    printed, error = (RELEASED["reference"][name][0] for name in ("exponents", "errors"))
    assert abs(long.exponents[0] - printed) < error
    assert 3 * long.errors[0] < 1.5 * error
    assert short.pairing < 1e-9 and long.pairing < 1e-9


@pytest.mark.long
def test_exponent_of_a_long_run_of_a_double_pendulum_is_the_published_one():
    """20,000 s: an error of a tenth of that printed."""
    motion = released(2_000_000)
    found = vi.orbits.lyapunov_spectrum(motion)
    printed, error = (RELEASED["reference"][name][0] for name in ("exponents", "errors"))
    assert abs(found.exponents[0] - printed) < error
    assert found.errors[0] < 0.15 * error
    assert np.abs(found.exponents[1:3]).max() < 2e-3 and found.pairing < 1e-9
    assert np.ptp(motion.energy) < 1e-9


def test_exponents_of_the_double_pendulum_are_those_of_an_independent_integration():
    """Two neighbours, 1e-8 apart, by SciPy's DOP853 and the equations of motion written by hand."""
    from scipy.integrate import solve_ivp

    def rate(_, x):
        (a, b, p, s), g = x, 9.81
        c, d = np.cos(a - b), np.sin(a - b)
        det = 2 - c * c
        return [
            p,
            s,
            (-d * (c * p * p + s * s) - 2 * g * np.sin(a) + g * np.sin(b) * c) / det,
            (d * (2 * p * p + c * s * s) + 2 * g * (np.sin(a) * c - np.sin(b))) / det,
        ]

    x, apart, logs = np.array([2.0, 2.5, 0, 0]), np.array([1e-8, 0, 0, 0]), []
    for _ in range(40):
        ends = [solve_ivp(rate, (0, 1.0), y, "DOP853", rtol=1e-10).y[:, -1] for y in (x, x + apart)]
        x, apart = ends[0], ends[1] - ends[0]
        size = np.linalg.norm(apart)
        logs.append(np.log(size / 1e-8))
        apart *= 1e-8 / size
    logs = np.array(logs[5:])
    model = vi.models.double_pendulum()
    motion = vi.simulate(model.system, vi.gauss(8), q0=[2, 2.5], v0=[0, 0], h=0.02, steps=10_000)
    found = vi.orbits.lyapunov_spectrum(motion)
    error = np.hypot(logs.std() / np.sqrt(len(logs)), found.errors[0])
    assert abs(found.exponents[0] - logs.mean()) < 3 * error < 1.0
    assert found.pairing < 1e-11 and found.exponents[0] > 1.0


def test_exponents_of_integrable_scenes_vanish_like_one_over_time():
    """ln t/t of shear, and 1/t of an oscillator, whose displacements do not grow at all."""
    q, v = vi.coordinates("x", "y")
    springs = vi.System(q, v, ca.sumsqr(v) / 2 - q[0] ** 2 / 2 - q[1] ** 2)
    still = vi.simulate(springs, vi.gauss(6), q0=[1, 0.3], v0=[0, 0.2], h=0.25, steps=4000)
    assert np.abs(vi.orbits.lyapunov_spectrum(still).exponents).max() < 3 / still.t[-1]
    model = vi.models.pendulum(theta0=2.0)
    for steps in (2000, 8000):
        motion = vi.simulate(
            model.system, vi.gauss(6), q0=model.q0, v0=model.v0, h=0.05, steps=steps
        )
        found = vi.orbits.lyapunov_spectrum(motion)
        t = motion.t[-1]
        assert 0.3 * np.log(t) / t < found.exponents[0] < 2 * np.log(t) / t


def test_megno_tends_to_two_on_tori_and_to_the_map_of_a_free_particle():
    """A free particle shears, |δ| → t: Y = 2 (1 − ln(1 + t)/t) from δ = 1 + t in closed form."""
    q, v = vi.coordinates("x")
    free = vi.simulate(vi.System(q, v, v**2 / 2), q0=0.0, v0=1.0, h=0.01, steps=10_000)
    found = vi.orbits.megno(free, displacement=[1.0, 1.0])
    sizes = np.sqrt(free.q[:, 0].max() / free.p[0, 0])  # the range of q by that of p, a fixed σ²
    assert sizes > 1
    y = (1 + free.t) ** 2 / sizes**2 + sizes**2
    logs = np.log(y / y[0]) / 2
    exact = 2 * np.sum((free.t[1:] + free.t[:-1]) / 2 * np.diff(logs)) / free.t[-1]
    assert np.isclose(found.values[-1], exact, rtol=1e-9)
    motion = henon_heiles(0.1, 1 / 12, 100_000, save_every=100)
    ordered = vi.orbits.megno(motion)
    assert abs(ordered.value - 2) < 0.05 and ordered.exponent < 5e-4


def test_nodes_that_were_left_out_change_nothing():
    """But lengths are told by the ranges of the nodes: the same ones in both."""
    every = henon_heiles(0.2, 1 / 12, 3000)
    widest = [int(k) for x in (every.q, every.p) for k in [*x.argmin(0), *x.argmax(0)]]
    few = every[sorted({*range(0, 3001, 500), *widest})]
    one, other = (vi.orbits.megno(motion) for motion in (every, few))
    assert np.allclose(one.means[few.k], other.means, rtol=1e-9)
    assert np.allclose(one.log_lengths[few.k], other.log_lengths, atol=1e-9)
    a, b = (vi.orbits.lyapunov_spectrum(motion).exponents for motion in (every, few))
    assert np.allclose(a, b, atol=1e-9)


def test_alignment_indices_tell_order_from_chaos():
    ordered, chaotic = henon_heiles(0.1, 1 / 12, 8000), henon_heiles(-0.25, 1 / 8, 8000)
    assert vi.orbits.sali(ordered).values[-1000:].min() > 0.1
    gone = vi.orbits.sali(chaotic)
    assert gone.value < 1e-12
    # e^{−(λ₁ − λ₂) t}: the slope of its logarithm, between its start and round-off
    some = (gone.values > 1e-13) & (gone.values < 1e-2)
    slope = np.polyfit(gone.t[some], np.log(gone.values[some]), 1)[0]
    assert -0.12 < slope < -0.02
    four = vi.orbits.gali(ordered, 4)  # t^{−4} on a torus of two frequencies
    late = slice(2000, None)
    power = np.polyfit(np.log(four.t[late]), np.log(four.values[late]), 1)[0]
    assert -4.6 < power < -3.4


def test_the_sum_of_exponents_is_the_mean_divergence():
    """−γ with friction −γ v, whatever the force: the discrete flow of q and p damps volumes so."""
    system, _ = driven_duffing()
    for gamma in (0.25, 0.1):
        motion = vi.simulate(
            system,
            vi.gauss(8),
            q0=1.0,
            v0=0.0,
            h=2 * np.pi / 60,
            steps=12_000,
            params=dict(gamma=gamma),
        )
        found = vi.orbits.lyapunov_spectrum(motion)
        assert np.isclose(found.sum, -gamma, atol=1e-9)
    assert vi.orbits.megno(motion).exponent < 0.3


def test_constraints_leave_two_exponents_a_degree_of_freedom_and_they_pair_to_round_off():
    pendulum = spherical_double_pendulum()
    q0 = [np.sin(2), 0, -np.cos(2), np.sin(2) + 0.8, 0.6, -np.cos(2)]
    start = dict(q0=q0, v0=np.zeros(6), h=0.01, steps=2000)
    motion = vi.simulate(pendulum, vi.lobatto(4), **start)
    found = vi.orbits.lyapunov_spectrum(motion)
    assert len(found.exponents) == 8 and found.pairing < 1e-10 and found.exponents[0] > 0.5
    # the same displacement, along the constraints by themselves and along the rods' angles
    plane = vi.models.pendulum_cartesian()
    angle = vi.models.pendulum()
    options = dict(h=0.01, steps=2000)
    x = [np.sin(2.0), -np.cos(2.0)]
    tied = vi.simulate(plane.system, vi.lobatto(5), q0=x, v0=[0, 0], **options)
    free = vi.simulate(angle.system, vi.gauss(6), q0=2.0, v0=0.0, **options)
    a, b = (vi.orbits.lyapunov_spectrum(m).exponents for m in (tied, free))
    assert len(a) == 2 and np.allclose(a, b, atol=0.05)
    assert vi.orbits.megno(tied).value == pytest.approx(vi.orbits.megno(free).value, abs=0.2)


def test_the_kicked_rotor_stretches_by_chirikovs_logarithm():
    """λ → ln(K/2) for large K (Chirikov 1979, §5.3)."""
    model = vi.models.kicked_rotor(K=20.0)
    motion = vi.simulate(
        model.system, vi.trapezoidal(), q0=model.q0, v0=model.v0, h=1.0, steps=2000
    )
    found = vi.orbits.lyapunov_spectrum(motion)
    assert abs(found.exponents[0] - np.log(10.0)) < 3 * found.errors[0] + 0.005 < 0.08
    assert found.pairing < 1e-9
    assert np.isclose(vi.orbits.megno(motion).exponent, found.exponents[0], rtol=0.01)


def test_fewer_exponents_are_the_first_of_all():
    motion = henon_heiles(-0.25, 1 / 8, 8000)
    few, every = (vi.orbits.lyapunov_spectrum(motion, count).exponents for count in (2, None))
    assert np.allclose(few, every[:2], atol=2e-3)


def test_bad_input_is_refused_in_words():
    motion = henon_heiles(0.1, 1 / 12, 20)
    bounce = vi.models.bouncing_ball()
    hit = vi.simulate(bounce.system, q0=bounce.q0, v0=bounce.v0, h=0.01, steps=10)
    for work, words in (
        (lambda: vi.orbits.megno(3), "motion from simulate"),
        (lambda: vi.orbits.megno(hit), "contacts"),
        (lambda: vi.orbits.megno(motion, displacement=[0, 0, 0, 0]), "not be zero"),
        (lambda: vi.orbits.megno(motion, displacement=[0, 0, 1]), r"must be \(4,\)"),
        (lambda: vi.orbits.lyapunov_spectrum(motion, 5), "more than the 4"),
        (lambda: vi.orbits.gali(motion, 7), "more than the 4"),
        (lambda: vi.orbits.tangent_lift(bounce.system), "contacts"),
        (lambda: vi.orbits.tangent_lift(motion), "varint System"),
    ):
        with pytest.raises(vi.InputError, match=words):
            work()
    pendulum = spherical_double_pendulum()
    q0 = [0.6, 0, -0.8, 1.2, 0.0, -1.6]
    tied = vi.simulate(pendulum, vi.lobatto(3), q0=q0, v0=np.zeros(6), h=0.01, steps=5)
    with pytest.raises(vi.InputError, match="leaves the constraints"):
        vi.orbits.megno(tied, displacement=np.ones(12))


def test_the_kicked_rotor_is_the_standard_map():
    model = vi.models.kicked_rotor(K=1.3)
    motion = vi.simulate(model.system, vi.trapezoidal(), q0=model.q0, v0=model.v0, h=1.0, steps=100)
    theta, kick = motion.q[:, 0], 1.3 * np.sin(motion.q[:, 0])
    between = motion.p[:, 0] - kick / 2
    assert np.allclose(np.diff(theta), between[:-1], atol=1e-12)
    assert np.allclose(np.diff(between), -kick[1:], atol=1e-12)
