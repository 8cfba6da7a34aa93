"""What the highest coefficients of stages tell of an error: it falls by the square of them."""

from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from numpy.polynomial import legendre

import varint as vi
from varint.codegen.gauss import gauss_kernel
from varint.codegen.kernel import run_loop
from varint.codegen.native import native_gauss
from varint.integration.graded_steps import stage_looks
from varint.integration.shown_by_stages import (
    Shown,
    begins_clearly,
    left_by_stages,
    made_by_stages,
    planned_by_stages,
    ratio_to,
    shown_by,
)

BELOW = 0.125  # of the highest coefficient but one: c/gauss_loop.c


def driven() -> tuple[vi.System, dict]:
    q, v, t = *vi.coordinates("x"), vi.time()
    scene = vi.System(q, v, v**2 / 2 + 9.81 * ca.cos(q), force=-0.2 * v + 3 * ca.cos(2 * t), t=t)
    return scene, {"q0": 1.0, "v0": 0.5}


def seen_by(scene, start, duration, steps, stages=8, gear=native_gauss):
    """(q at nodes, d of steps) of a run."""
    rule = vi.gauss(stages)
    kernel = gear(scene, rule)
    begun = vi.simulate(scene, rule, **start, h=1e-3, steps=1)
    looks = stage_looks(scene, rule)
    at = looks.heights, looks.counts[0]
    asked = {"t0": 0.0, "h": duration / steps, "steps": steps, "looks": at}
    found = run_loop(kernel, begun.q[0], begun.p[0], begun.c, **asked)
    assert found.done
    return found.rows[:, 0], shown_by(found.seen, steps, scene.structure.n).d


@pytest.mark.parametrize("gear", (native_gauss, gauss_kernel))
@pytest.mark.parametrize("stages", (4, 8))
@pytest.mark.parametrize("degree", (0, 1, 2))
def test_what_is_seen_are_the_highest_legendre_coefficients(stages, degree, gear):
    """A force that is the Legendre polynomial of a step's own highest degree, or one below, beside
    the longest path of a step.
    """
    q, v, t = *vi.coordinates("x"), vi.time()
    h, v0, high, mean = 0.5, 9.0, 0.25, 2.0
    of = np.zeros(stages)
    of[stages - 1 - degree] += high
    of[0] += mean
    x = 4 * (t - h * ca.floor(t / h)) - 1
    force = sum(float(c) * x**k for k, c in enumerate(legendre.leg2poly(of)))
    scene = vi.System(q, v, v**2 / 2, force=force, t=t)
    seen = seen_by(scene, {"q0": 0.0, "v0": v0}, 4 * h, 4, stages, gear)[1]
    longest = h * (v0 + 4 * mean * h)
    assert seen == pytest.approx(h**2 * high * (1.0, BELOW, 0.0)[degree] / longest, abs=1e-14)


def test_both_gears_see_the_same_bytes():
    scene, start = driven()
    one, other = (seen_by(scene, start, 10.0, 40, 8, gear) for gear in (native_gauss, gauss_kernel))
    assert one[1].tobytes() == other[1].tobytes()


def squeezed() -> tuple[vi.System, dict]:
    """A mass between walls that come near it, with friction."""
    q, v = vi.coordinates("x", "y")
    walls = 0.3 / (1 - q[0] ** 2) + 0.2 * q[0] * q[1] + q[1] ** 4
    return vi.System(q, v, ca.sumsqr(v) / 2 - walls, force=-0.1 * v), {
        "q0": [0.3, 0.4],
        "v0": [0.8, -0.5],
    }


@pytest.mark.parametrize("build", (driven, squeezed))
def test_errors_fall_by_the_square_of_what_stages_show(build):
    """Gauss' rule with four stages, twice as many steps: d, which is of third and second degree,
    falls by 2² to 2³, the error by 2⁸.
    """
    scene, start = build()
    exact = vi.simulate(scene, **start, duration=6.0, tol=1e-13)
    size = np.abs(exact.q).max()

    def of(steps):
        q, d = seen_by(scene, start, 6.0, steps, 4)
        there = exact.at(np.linspace(0, 6.0, steps + 1)).q
        return d.max(), np.abs(q - there).max() / size

    runs = [of(steps) for steps in (40, 80, 160)]
    fallen, errors = (np.log2([x[i] / y[i] for x, y in pairwise(runs)]) for i in (0, 1))
    assert 2.0 <= fallen[1] <= 3.2
    assert 7.0 <= errors[1] <= 9.0
    assert (errors >= 2 * fallen).all()


@pytest.mark.parametrize("build", (driven, squeezed))
@pytest.mark.parametrize("steps", ((16, 24), (16, 32), (20, 40), (24, 72), (32, 48)))
def test_what_is_left_is_not_less_than_the_error(build, steps):
    scene, start = build()
    exact = vi.simulate(scene, **start, duration=6.0, tol=1e-13)
    size = np.abs(exact.q).max()
    runs = [seen_by(scene, start, 6.0, n) for n in steps]
    unit = np.gcd(*steps)
    apart = np.abs(runs[0][0][:: steps[0] // unit] - runs[1][0][:: steps[1] // unit]).max() / size
    there = exact.at(np.linspace(0, 6.0, steps[1] + 1)).q
    error = np.abs(runs[1][0] - there).max() / size
    shown = [Shown(n, d) for n, (_, d) in zip(steps, runs, strict=True)]
    left = left_by_stages(*shown, apart, 16)
    assert error <= left + 1e-14
    # and says more than that two runs are so far apart
    assert left < (0.5 if steps[1] < 2 * steps[0] else 0.05) * apart


def test_what_does_not_fall_is_not_counted_on():
    """A kink: d falls by little there, however fast elsewhere."""
    coarse, fine = np.full(16, 1e-3), np.full(32, 4e-6)
    assert left_by_stages(Shown(16, coarse), Shown(32, fine), 1e-6, 16) < 1e-9
    coarse[5], fine[10] = 2e-3, 1e-3
    assert left_by_stages(Shown(16, coarse), Shown(32, fine), 1e-6, 16) == np.inf
    coarse[5], fine[10] = 1e-3, 1e-4
    made = made_by_stages(fine)[0]
    left = left_by_stages(Shown(16, coarse), Shown(32, fine), 1e-6, 16)
    assert left == pytest.approx(max(made, 4.04e-8 / (1 - 4.04e-2)))


def test_steps_that_miss_by_as_much_become_so_many_times_more():
    assert ratio_to(16, 1e-9, 1e-3, 16) == 1.5
    assert [ratio_to(16, x, 1e-9, 16) for x in (1e-7, 3e-6, 1e-4, 1.0)] == [2.0, 2.5, 3.0, 3.0]
    assert ratio_to(15, 1e-9, 1e-3, 16) == 2.0  # half as many more are no whole number


@pytest.mark.parametrize(
    ("e", "z", "v", "duration", "tol"),
    (
        (0.35417420770187513, -0.8780276065317292, -0.2737287095722484, 27.775092942645358, 7.7e-6),
        (0.3017239581491592, -0.8190802914793283, 0.4760982655292231, 5.490615295583208, 1.5e-6),
        (0.49689535405340074, 1.4973641396844064, -0.2784673830782719, 12.763221969220993, 3.3e-6),
        (0.24413732941094424, 1.0324875645724143, 0.09733984900182291, 27.2463509280077, 5.3e-7),
        (0.46862262280746086, 0.49202152076285555, -0.4622729964061373, 7.3639056342545794, 1.5e-7),
        (0.091354336889171, -0.48733782830577566, 0.16234233062036918, 11.646766547779686, 1e-9),
    ),
)
def test_narrow_passages_are_not_taken_for_smooth_ones(e, z, v, duration, tol):
    """Sitnikov's mass passes between two stars as fast as steps are long."""
    (q, w), t = vi.coordinates("z"), vi.time()
    r = 0.5 * (1 - e * ca.cos(t) + 0.5 * e**2 * (1 - ca.cos(2 * t)))
    scene = vi.System(q, w, w**2 / 2 + 1 / ca.sqrt(q**2 + r**2), t=t)
    asked = {"q0": z, "v0": v, "duration": duration, "progress": False}
    found, exact = (vi.simulate(scene, **asked, tol=x) for x in (tol, 1e-13))
    error = np.abs(found.q[-1] - exact.q[-1]).max() / np.abs(exact.q).max()
    assert error <= tol


def test_what_begins_from_rest_is_small_beside_what_it_becomes():
    """x = t⁵ / 20: coefficients of its first step are large beside what it does there alone."""
    q, v, t = *vi.coordinates("x"), vi.time()
    scene = vi.System(q, v, v**2 / 2, force=t**9, t=t)
    d = seen_by(scene, {"q0": 0.0, "v0": 0.0}, 4.0, 16)[1]
    assert d[0] < 1e-9
    assert d.max() < 1e-6


def test_two_runs_prove_what_took_three():
    scene, start = squeezed()
    found = vi.simulate(scene, **start, duration=6.0, tol=1e-9, progress=False)
    exact = vi.simulate(scene, **start, duration=6.0, tol=1e-13, progress=False)
    assert found.stats["runs"] == 2
    assert np.abs(found.q[-1] - exact.q[-1]).max() <= found.stats["error_estimate"] <= 1e-9


def test_a_run_that_does_not_resolve_the_motion_is_followed_by_one_whose_successor_may_prove_it():
    """Steps so many times as many as square 1.5, or more: the second run has twice as many."""
    for size, tol, ratio in (
        (0.1, 1e-3, 1.5),
        (0.1, 1e-9, 2.0),
        (1.0, 1e-3, 1.5),
        (1.0, 1e-6, 2.0),
    ):
        d = np.append(size, np.full(15, 1e-6))
        planned, _, tells = planned_by_stages(Shown(16, d), tol, 16)
        assert planned == ratio
        assert tells


def test_no_first_run_over_forces_has_fewer_than_eight_steps():
    """One of fewer steps takes as long: they are iterated longer, and some of them in vain."""
    q, v = vi.coordinates("x", "y")
    scene = vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[1], force=-0.1 * ca.norm_2(v) * v)
    motion = vi.simulate(scene, q0=[0, 0], v0=[3.0, 4.0], duration=1.0, tol=1e-3)
    assert motion.stats["steps"] >= 12
    closer = vi.simulate(scene, q0=[0, 0], v0=[3.0, 4.0], duration=1.0, tol=1e-12)
    assert np.abs(motion.q[-1] - closer.q[-1]).max() < 1e-8


def test_a_begin_is_clear_where_stages_of_the_first_steps_show_it():
    """Only these steps count; a coarser run that does not resolve them tells nothing."""
    smooth, none = np.full(12, 1e-6), np.zeros(0)
    layer = np.append(0.3, smooth[1:])
    assert begins_clearly(Shown(8, layer[:8]), Shown(12, smooth), 2, 1e-9, 16)
    assert not begins_clearly(Shown(8, smooth[:8]), Shown(12, layer), 2, 1e-9, 16)
    late = np.append(smooth[:11], 0.3)
    assert begins_clearly(Shown(8, none), Shown(12, late), 2, 1e-9, 16)
    assert not begins_clearly(Shown(8, none), Shown(12, none), 2, 1e-9, 16)
    coarse = np.full(8, 3e-4)
    assert begins_clearly(Shown(8, coarse), Shown(12, none), 2, 1e-8, 16)
    assert not begins_clearly(Shown(8, 100 * coarse), Shown(12, none), 2, 1e-8, 16)


@pytest.mark.parametrize("tol", (1e-3, 1e-6, 1e-9))
@pytest.mark.parametrize("speed", (0.0, 1.0, 3.0))
def test_the_first_nodes_of_a_motion_with_a_transient_are_right(speed, tol):
    """A strong damper stops what moves within a part of the first steps."""
    q, v = vi.coordinates("x", "y")
    energy = ca.sumsqr(q) / 2 + q[0] ** 2 * q[1] / 5
    damped = vi.System(q, v, ca.sumsqr(v) / 2 - energy, force=-ca.vertcat(40 * v[0], 0.3 * v[1]))
    start = dict(q0=[0.7, -0.4], v0=[speed, -0.5])
    motion = vi.simulate(damped, **start, duration=6.0, tol=tol)
    exact = vi.simulate(damped, vi.gauss(8), **start, h=6.0 / 20_000, steps=20_000)
    assert np.abs(motion.q - exact.at(motion.t).q).max() < 2 * tol * np.abs(exact.q).max()
