"""Orbits with close encounters take short steps where the motion is fast; poor guesses come to an
orbit, and are told how far it is; nothing is silent.
"""

import re

import casadi as ca
import numpy as np
import pytest
from references import entries

import varint as vi
from varint import orbits
from varint.integration import compiled_loop
from varint.numerics import progress
from varint.orbits.continuation import stepped
from varint.orbits.curve import Curve
from varint.orbits.follow import MOST_STEPS
from varint.orbits.passages import point_of
from varint.orbits.predict import ahead, on_cubic


def hill() -> vi.System:
    """Hill's lunar problem."""
    q, v = vi.coordinates("x", "y")
    turning = q[0] * v[1] - q[1] * v[0]
    return vi.System(q, v, ca.sumsqr(v) / 2 + turning + 1.5 * q[0] ** 2 + 1 / ca.norm_2(q))


@pytest.fixture(scope="module")
def close():
    """An orbit that comes within 0.045 of the Moon."""
    energy = -1.5 * 3 ** (1 / 3) + 0.05
    return orbits.periodic(hill(), ([0.6, 0.0], [0.0, 0.4]), period=2.8, energy=energy)


def test_uneven_segments_make_the_same_orbit_with_fewer_steps(close):
    assert close.shooting.parts is not None
    assert close.shooting.parts.sum() == pytest.approx(1.0, abs=1e-15)
    even = orbits.periodic(
        close.system, (close.q0, close.v0), period=close.period, energy=close.energy, steps=1128
    )
    assert close.steps < even.steps / 3
    assert close.error_estimate < 1e-13 and even.error_estimate < 1e-12
    assert close.period == pytest.approx(even.period, rel=1e-12)
    pair = [np.sort(x.floquet.multipliers.real) for x in (close, even)]
    assert pair[0] == pytest.approx(pair[1], rel=1e-10)


def test_the_motion_of_an_orbit_in_uneven_segments_is_a_trajectory_like_any_other(close, tmp_path):
    motion = close.motion
    assert motion.sizes.min() < motion.sizes.max() / 4
    assert np.diff(motion.t) == pytest.approx(motion.sizes, rel=1e-9)
    assert motion.t[-1] == pytest.approx(close.period, rel=1e-14)
    assert np.ptp(motion.energy) < 1e-11
    middle = motion.at(0.37 * close.period)
    run = vi.simulate(
        close.system,
        vi.gauss(6),
        q0=close.q0,
        p0=close.p0,
        h=0.37 * close.period / 3000,
        steps=3000,
    )
    assert np.abs(middle.q - run.q[-1]).max() < 1e-11
    close.save(tmp_path / "orbit.npz")
    again = vi.load(tmp_path / "orbit.npz")
    assert (again.shooting.parts == close.shooting.parts).all()
    assert (again.motion.q == motion.q).all()


@pytest.mark.long
def test_a_narrow_ellipse_of_kepler_has_keplers_period():
    model = vi.models.kepler(e=0.99)
    half = 2 * np.pi  # of a semi-major axis of one
    found = orbits.periodic(model.system, (model.q0, model.v0), period=half, energy=-0.5)
    assert found.shooting.parts.max() > 30 * found.shooting.parts.min()
    assert found.period == pytest.approx(half, rel=1e-12)
    assert found.floquet.trivial == 4


@pytest.mark.long
def test_a_family_towards_a_collision_takes_as_many_steps_at_its_end_as_at_its_beginning(close):
    found = orbits.family(close, most=60, progress=False)
    nearest = [np.linalg.norm(one.motion.q, axis=1).min() for one in (found[0], found[-1])]
    assert nearest[1] < nearest[0] / 20
    end = np.median([one.steps for one in found[-10:]])
    assert end < 4 * found[0].steps < MOST_STEPS
    assert max(one.error_estimate for one in found) < 1e-10
    integrate = pytest.importorskip("scipy.integrate")
    last = found[-1]

    def rate(t, y):
        pull = y[:2] / np.linalg.norm(y[:2]) ** 3
        return [y[2], y[3], 2 * y[3] + 3 * y[0] - pull[0], -2 * y[2] - pull[1]]

    start = np.concatenate([last.q0, last.v0])
    run = integrate.solve_ivp(rate, (0, last.period), start, "DOP853", rtol=1e-13, atol=1e-15)
    assert np.abs(run.y[:, -1] - start).max() < 1e-7  # a neighbour's distance grows 1e4-fold


@pytest.mark.parametrize("more", [0.01, pytest.param(0.02, marks=pytest.mark.long)])
def test_a_family_past_the_moon_ends_at_its_value_by_steps_alone(more, monkeypatch):
    """The energy bends between two orbits, and steps that were too long set nothing up."""
    table = entries("orbits")["Lyapunov orbits of Earth and Moon"]
    row = table["reference"]["L2, least stability index"]
    start = [row["x"], 0, 0], [0, row["vy"], 0]
    space = vi.models.restricted_three_body().system
    first = orbits.periodic(space, start, period=row["period"], params=table["params"])

    def refused(*args):
        raise AssertionError("Newton's method was set up for a step that is made shorter anyway")

    monkeypatch.setattr(compiled_loop, "_by_newton", refused)
    to = first.energy + more
    found = orbits.family(first, to=to, bifurcations=False, progress=False)
    assert found.ended == f"at energy={to:.10g}"
    assert found[-1].energy == pytest.approx(to, abs=1e-12)
    assert np.diff(found.energies).min() > 0 and np.diff(found.periods).min() > 0
    assert max(one.residual for one in found) < 1e-12


def test_small_orbits_far_from_the_origin_take_no_more_steps_along_their_family():
    """About L1 of Sun and Earth ranges are 1e-5 of the coordinates: round-off of 1e-11 in ranges is
    not mistaken for an error of the steps.
    """
    space, held = vi.models.restricted_three_body().system, dict(mu=3.0404e-6)
    modes = orbits.normal_modes(space, orbits.equilibria(space, [0.99, 0, 0], params=held)[0])
    found = orbits.family(modes.orbit(2, 1e-5), most=8, bifurcations=False, progress=False)
    assert len(found) == 8 and max(one.steps for one in found) < 1.5 * found[0].steps
    assert found.periods == pytest.approx(2 * np.pi / modes.frequencies[2], rel=1e-4)
    assert np.diff(found.periods).min() > 0


def test_the_next_orbit_is_looked_for_on_a_cubic():
    """Its distance from there is of fourth order in the step, from the tangent of second."""
    q, v = vi.coordinates("x", "y")
    well = ca.sumsqr(q) / 2 + q[0] ** 2 * q[1] - q[1] ** 3 / 3
    first = orbits.normal_modes(vi.System(q, v, ca.sumsqr(v) / 2 - well), [0.0, 0.0])
    start = orbits.periodic(
        first.system, ([0.0, 0.3], [0.0, 0.0]), period=6.4, energy=0.04, steps=60
    )
    curve = Curve("energy", None, None, 0.0)
    here = point_of(start, curve, None, 1.0)
    apart = []
    for step in (0.04, 0.08):
        orbit, by = here.orbit, here.by
        back = stepped(orbit, here.tangent, -step, curve, by)
        on = stepped(orbit, here.tangent, step, curve, by)
        other = back, point_of(back, curve, here.tangent, 1.0).tangent
        guesses = [
            on_cubic(orbit, here.tangent, other, step, curve, by),
            ahead(orbit, here.tangent, step, curve),
        ]
        apart.append([abs(one.period - on.period) for one in guesses])
    order = np.log2(np.array(apart[1]) / np.array(apart[0]))
    assert 3.5 < order[0] < 4.5 and 1.8 < order[1] < 2.2


def test_a_poor_guess_comes_to_an_orbit_by_small_steps():
    """A loop in a logarithmic potential, guessed at another energy and with another period."""
    q, v = vi.coordinates("x", "y")
    well = ca.log(0.14**2 + q[0] ** 2 + q[1] ** 2 / 0.81) / 2
    galaxy = vi.System(q, v, ca.sumsqr(v) / 2 - well)
    loop = orbits.periodic(galaxy, ([0.5, 0.0], [0.0, 0.9]), period=3.4, energy=0.0)
    assert loop.energy == pytest.approx(0.0, abs=1e-13) and loop.residual < 1e-12
    turned = loop.motion.q[:, 0] * loop.motion.v[:, 1] - loop.motion.q[:, 1] * loop.motion.v[:, 0]
    assert (turned > 0).all()  # it goes round


def test_an_orbit_far_from_the_guess_is_found_with_a_warning():
    q, v = vi.coordinates("x")
    duffing = vi.System(q, v, (v**2 - q**2 - q**4 / 2) / 2)
    with pytest.warns(UserWarning, match=r"of its ranges from the guess, and its period is"):
        orbits.periodic(duffing, ([0.2], [0.0]), period=6.0, energy=40.0)


def test_a_search_says_how_far_it_is_where_nobody_watches(monkeypatch, capsys, close):
    monkeypatch.setattr(progress, "SILENCE", 0.005)
    orbits.periodic(close.system, (close.q0, close.v0), period=close.period, energy=close.energy)
    assert re.search(r"looking for a periodic orbit: \d+ s", capsys.readouterr().err)
    orbits.family(close, most=9, bifurcations=False)
    assert re.search(r"family of orbits: \d+ s, \d orbits, energy=-2\.", capsys.readouterr().err)
    orbits.family(close, most=2, progress=False)
    assert capsys.readouterr().err == ""
