"""Multipliers of the figure-eight pass ±1 in pairs that stay on the circle, for its symmetries keep
them there: where, against a publication, and what branches off.
"""

import casadi as ca
import numpy as np
import pytest
from references import entries

import varint as vi
from varint import orbits

EIGHT = entries("orbits")["figure-eight"]["reference"]
OTHERS = entries("orbits")["figure-eight in other potentials"]["reference"]


@pytest.fixture(scope="module")
def bodies():
    """Three equal masses that attract each other by −1/r^a."""
    q, v = vi.coordinates("x1", "y1", "x2", "y2", "x3", "y3")
    c = vi.Parameters(a=1.0)
    apart = [
        ca.norm_2(q[2 * i : 2 * i + 2] - q[2 * j : 2 * j + 2]) for i in range(3) for j in range(i)
    ]
    return vi.System(q, v, ca.sumsqr(v) / 2 + sum(r**-c.a for r in apart), params=c)


def eight(bodies, start, a):
    x, v = np.array(start["x1"]), np.array(start["v3"])
    state = (np.r_[x, -x, 0, 0], np.r_[-v / 2, -v / 2, v])
    return orbits.periodic(bodies, state, period=EIGHT["period"], params=dict(a=a))


def test_pairs_of_springs_pass_one_and_minus_one_on_the_circle():
    """Along x, a spring of ω = 1, the other has the multipliers exp(±2πi w): a branch point at
    w = 1, where all motions have its period, a period doubling at 3/2.
    """
    q, v = vi.coordinates("x", "y")
    c = vi.Parameters(w=0.95)
    springs = vi.System(q, v, (v.T @ v - q[0] ** 2 - c.w**2 * q[1] ** 2) / 2, params=c)
    along = orbits.periodic(springs, ([1, 0], [0, 0]), period=2 * np.pi, energy=0.5, steps=32)
    found = orbits.family(along, along="w", to=1.55, hold="energy").bifurcations
    assert [one.kind for one in found] == ["branch point", "period doubling"]
    assert np.abs([one.value - at for one, at in zip(found, (1, 1.5), strict=True)]).max() < 1e-9
    for one, laps in zip(found, (1, 2), strict=True):
        other = one.branch()
        assert other.period == pytest.approx(2 * np.pi * laps, rel=1e-10)
        assert np.abs(other.motion.q[:, 1]).max() > 0.01


def test_two_pairs_that_pass_in_one_step_are_told_apart():
    """A third spring, stiffer by a thousandth, passes first."""
    q, v = vi.coordinates("x", "y", "z")
    c = vi.Parameters(w=0.95)
    pull = q[0] ** 2 + c.w**2 * (q[1] ** 2 + 1.001**2 * q[2] ** 2)
    springs = vi.System(q, v, (v.T @ v - pull) / 2, params=c)
    along = orbits.periodic(springs, ([1, 0, 0], [0, 0, 0]), period=2 * np.pi, energy=0.5, steps=32)
    found = orbits.family(along, along="w", to=1.05, hold="energy").bifurcations
    assert [one.kind for one in found] == ["branch point", "branch point"]
    assert [one.value for one in found] == pytest.approx([1 / 1.001, 1], abs=1e-8)


def test_multipliers_of_the_figure_eight_pass_one_where_its_morse_index_is_published_to_change(
    bodies,
):
    before = eight(bodies, OTHERS["start"], OTHERS["start"]["a"])
    [found] = orbits.family(before, along="a", to=1.345).bifurcations
    assert found.kind == "branch point"
    assert abs(found.value - OTHERS["passes"]) < 5e-5  # all digits printed
    assert found.value == pytest.approx(OTHERS["again"][1], abs=1e-7)
    assert np.sort(np.abs(found.orbit.floquet.multipliers - 1))[:2].max() < 1e-5


@pytest.mark.long
def test_what_branches_off_the_figure_eight_is_the_published_orbit(bodies):
    first = eight(bodies, EIGHT, 1.0)
    [found] = orbits.family(first, along="a", to=0.995).bifurcations
    assert found.kind == "branch point"
    assert found.value == pytest.approx(OTHERS["again"][0], abs=1e-7)
    off = [found.branch(0.005, sign) for sign in (1, -1)]
    off = max(off, key=lambda one: one.at.c[0])
    branch = orbits.family(off, along="a", to=1.0, bifurcations=False)[-1]
    row = OTHERS["branch"]
    v = np.array(row["v1"])
    start = (np.r_[row["x1"], 0, -row["x1"], 0, 0, 0], np.r_[v, v, -2 * v])
    printed = orbits.periodic(bodies, start, period=row["period"], energy=row["energy"])
    assert np.abs(printed.at.x[0] - np.concatenate(start)).max() < 3e-5
    assert abs(printed.period - row["period"]) < 2e-3
    scaled, own, eights = (
        one.period * np.abs(one.energy / row["energy"]) ** 1.5 for one in (branch, printed, first)
    )
    assert scaled == pytest.approx(own, rel=1e-11)
    assert abs(eights / own - 1) > 1e-7  # they are told apart by far
    near = [np.sort_complex(one.floquet.multipliers) for one in (branch, printed)]
    assert np.abs(near[0] - near[1]).max() < 1e-7


def test_where_no_closed_orbit_branches_off_a_momentum_is_stationary_along_orbits_that_turn(bodies):
    """At a = 1.22834 a multiplier of the eight passes 1: along eights that turn with the rate Ω, an
    orbit each in the frame that turns with them, dJ/dΩ = 0.
    """
    first = eight(bodies, EIGHT, 1.0)
    found = orbits.family(first, along="a", to=1.24).bifurcations
    assert [one.kind for one in found] == ["period doubling", "fold in an integral"]
    passes = found[1].value
    assert passes == pytest.approx(1.228336, abs=1e-6)
    with pytest.raises(vi.InputError, match="corotating"):
        found[1].branch()
    [turn] = (one for one in vi.symmetries(bodies) if one.name == "rotation about z")
    turning = orbits.corotating(bodies, turn)
    slopes = []
    for a in (passes - 1e-3, passes, passes + 1e-3):
        still = orbits.family(first, along="a", to=a, bifurcations=False)[-1]
        start, rate = (still.q0, still.v0), 1e-3
        resting = orbits.periodic(turning, start, period=still.period, params=dict(a=a))
        moving = orbits.family(resting, along="rate", to=rate, bifurcations=False)[-1]
        x, p = (part.reshape(3, 2) for part in (moving.q0, moving.motion.p[0]))
        slopes.append((x[:, 0] @ p[:, 1] - x[:, 1] @ p[:, 0]) / rate)
    assert slopes[0] < 0 < slopes[2]
    assert abs(slopes[1]) < 2e-3 * (slopes[2] - slopes[0])
