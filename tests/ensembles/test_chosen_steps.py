"""Ensembles whose steps are chosen: each member is what `simulate` makes of it, within the
tolerance of closed forms.
"""

from __future__ import annotations

import pickle
import warnings

import casadi as ca
import numpy as np
import pytest
from ensemble_scenes import pushed, swinging
from scenes import double_pendulum, henon_heiles
from scipy.special import ellipj, ellipk

import varint as vi

TIMES = np.linspace(0, 10, 101)


def kepler() -> vi.System:
    q, v = vi.coordinates("x", "y")
    return vi.System(q, v, ca.sumsqr(v) / 2 + 1 / ca.sqrt(ca.sumsqr(q)))


def circle() -> vi.System:
    q, v = vi.coordinates("x", "y")
    return vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[1], constraint=ca.sumsqr(q) - 1)


def blade() -> vi.System:
    q, v = vi.coordinates("x", "y", "angle")
    rolling = v[0] * ca.sin(q[2]) - v[1] * ca.cos(q[2])
    return vi.System(q, v, ca.sumsqr(v) / 2 - q[0], nonholonomic=ca.jacobian(rolling, v))


def ball() -> vi.System:
    q, v = vi.coordinates("height")
    return vi.System(q, v, v**2 / 2 - 9.81 * q, contact=q, restitution=0.8)


def rubbed() -> vi.System:
    q, v = vi.coordinates("x")
    return vi.System(q, v, v**2 / 2 - q**2 / 2, force=-0.2 * ca.sign(v))


PUSH = np.random.default_rng(3).normal(size=(4, 5, 1))
ANGLES = np.array([0.3, 1.0, 2.0, 3.0])
CASES = {
    "pendulum": (swinging, dict(q0=ANGLES, v0=0.0)),
    "lengths": (swinging, dict(q0=0.5, v0=0.1, params=dict(length=[0.5, 1.0, 2.0, 4.0]))),
    "backwards": (swinging, dict(q0=ANGLES, v0=0.0, t0=2.0, at=np.array([1.5, 1.0, -3.0]))),
    "momenta": (henon_heiles, dict(q0=[0.1, 0.0], p0=0.1 * np.arange(8).reshape(4, 2) / 4)),
    "loose": (swinging, dict(q0=ANGLES, v0=0.0, tol=1e-4)),
    "rule": (swinging, dict(q0=ANGLES, v0=0.0, rule=vi.gauss(3))),
    "interpreted": (swinging, dict(q0=ANGLES, v0=0.0, backend="interpreted", tol=1e-6)),
    "longer": (swinging, dict(q0=ANGLES, v0=0.0, duration=12.0)),
    "orbits": (kepler, dict(q0=[1, 0], v0=np.outer([1.0, 1.1, 0.6, 0.3], [0, 1]))),
    "circle": (circle, dict(q0=np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1), v0=[0, 0])),
    "blade": (blade, dict(q0=[0, 0, 0], v0=np.outer(ANGLES, [1, 0, 1]))),
    "ball": (ball, dict(q0=ANGLES, v0=0.0, at=np.linspace(0, 1.2, 7))),
    "rubbed": (rubbed, dict(q0=ANGLES, v0=0.0)),
    "pushed": (pushed, dict(q0=[0, 0.5], v0=[0, 0], u=PUSH[:, :1], duration=2.0)),
    "pushed alike": (pushed, dict(q0=np.outer(ANGLES, [0, 1]), v0=[0, 0], u=0.3, duration=2.0)),
    "tables": (pushed, dict(q0=[0, 0.5], v0=[0, 0], u=PUSH, duration=2.0, tol=1e-6)),
}


def one(i: int, words: dict) -> dict:
    """The arguments of member i out of those of all four."""
    whole = {"q0": 2, "v0": 2, "p0": 2, "u": 3}
    own = dict(words)
    for name, axes in whole.items():
        x = np.asarray(words.get(name, 0.0))
        if x.ndim == axes or (x.ndim == 1 and len(x) == 4):
            own[name] = x[i]
    if "params" in words:
        own["params"] = {name: x[i] for name, x in words["params"].items()}
    return own


@pytest.mark.parametrize("case", CASES)
def test_every_member_is_what_simulate_makes_of_it_bit_for_bit(case):
    make, words = CASES[case]
    system, words = make(), dict(words)
    if "at" not in words:
        words["at"] = np.linspace(0, words.get("duration", 10.0), 23)
    sweep = vi.ensemble(system, **words)
    assert len(sweep) == 4 and not len(sweep.failed)
    np.testing.assert_array_equal(sweep.t, words["at"])
    pushes = ca.sumsqr(system.control) + system.t
    energies, given = sweep.energy, sweep.value(pushes)
    for i, motion in enumerate(sweep):
        alone = vi.simulate(system, **one(i, words))
        assert sweep.q[i].tobytes() == alone.q.tobytes()
        assert sweep.p[i].tobytes() == alone.p.tobytes()
        assert sweep.error_estimate[i] == alone.stats["error_estimate"] <= words.get("tol", 1e-9)
        assert sweep.steps[i] == alone.stats["steps"] > 0
        assert motion.rule == alone.rule and motion.stats["member"] == i
        np.testing.assert_allclose(energies[i], alone.energy, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(sweep.v[i], alone.v, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(given[i], alone.value(pushes), rtol=1e-15)


@pytest.mark.parametrize("case", CASES)
def test_between_its_nodes_a_member_is_as_accurate_as_at_them(case):
    """Beside the motion with nodes of its own, at times between the few that were asked for."""
    make, words = CASES[case]
    system, words = make(), dict(words)
    times = words.pop("at", np.linspace(0, words.get("duration", 10.0), 4))
    words["duration"] = words.get("duration", times[-1] - words.get("t0", 0.0))
    sweep = vi.ensemble(system, at=times, **words)
    between = times[:-1, None] + np.diff(times)[:, None] * np.array([0.1, 0.45, 0.8])
    for i in range(4):
        whole = vi.simulate(system, **one(i, words)).at(between.ravel()).q
        np.testing.assert_allclose(
            sweep[i].at(between.ravel()).q, whole, atol=10 * words.get("tol", 1e-9)
        )


def test_pendulums_are_within_the_tolerance_of_elliptic_functions():
    """θ = 2 arcsin(k sn(K(k²) − ω t, k²)) with k = sin(θ0/2), of any length; errors in radians."""
    angles, lengths = np.linspace(0.1, 3.0, 40), np.linspace(0.5, 2.0, 40)
    for tol in (1e-3, 1e-6, 1e-9):
        sweep = vi.ensemble(
            swinging(), q0=angles, v0=0.0, params=dict(length=lengths), duration=10.0, tol=tol
        )
        k, phase = np.sin(angles / 2)[:, None], np.sqrt(9.81 / lengths)[:, None] * sweep.t
        exact = 2 * np.arcsin(k * ellipj(ellipk(k**2) - phase, k**2)[0])
        assert sweep.q.shape == (40, 101, 1) and sweep.t[-1] == 10.0
        assert np.abs(sweep.q[:, :, 0] - exact).max() < tol
        assert np.all(sweep.error_estimate <= tol)


def test_orbits_come_back_within_the_tolerance():
    """Kepler: after a period 2π all orbits of half-axis 1 are where they began."""
    e = np.linspace(0.0, 0.9, 10)
    starts = np.stack([1 - e, 0 * e], axis=1), np.stack([0 * e, np.sqrt((1 + e) / (1 - e))], axis=1)
    sweep = vi.ensemble(kepler(), q0=starts[0], v0=starts[1], at=2 * np.pi * np.arange(3))
    assert np.abs(sweep.q - starts[0][:, None]).max() < 2e-9
    assert len({str(motion.rule) for motion in sweep} | {len(set(sweep.steps))}) > 1


def test_times_from_the_start_to_the_end_are_nodes_by_default():
    sweep = vi.ensemble(swinging(), q0=[0.1, 0.2], v0=0.0, duration=-3.0, t0=1.0)
    np.testing.assert_array_equal(sweep.t, np.linspace(1.0, -2.0, 101))
    assert sweep.h is None and sweep.rule is None and len(sweep.k) == 101
    assert repr(sweep) == "Ensemble(2 members × 101 nodes, steps for tol = 1e-09)"
    assert "steps for tol = 1e-09" in sweep._repr_html_()
    assert vi.ensemble(swinging(), q0=[0.1, 0.2], v0=0.0, h=0.1, steps=2).error_estimate.size == 2


def test_statistics_are_those_of_the_members():
    system, angles = swinging(), np.linspace(0.1, 2.0, 30)
    sweep = vi.ensemble(system, q0=angles, v0=0.0, at=TIMES)
    each = np.array([vi.simulate(system, q0=a, v0=0.0, at=TIMES).q[:, 0] for a in angles])
    np.testing.assert_allclose(sweep.mean(system.q), each.mean(axis=0), atol=1e-14)
    np.testing.assert_allclose(sweep.std(system.q), each.std(axis=0, ddof=1), atol=1e-14)
    np.testing.assert_allclose(sweep.quantiles(system.q)[1], np.median(each, axis=0), atol=1e-14)
    again = pickle.loads(pickle.dumps(sweep))
    assert again.q.tobytes() == sweep.q.tobytes() and again[3].q.tobytes() == sweep[3].q.tobytes()
    assert sweep.plot().axes


def escaping() -> dict:
    """Stars in Hénon and Heiles' potential: two of them are faster than its walls are high, and
    leave for infinity, which they reach in a finite time.
    """
    return dict(
        q0=[[0.1, 0.0], [0.2, 0.5], [0.0, 0.1], [0.4, -0.8], [0.1, 0.1]],
        v0=[[0.0, 0.1], [0.1, 0.9], [0.1, 0.0], [0.9, -0.9], [0.0, 0.0]],
    )


def test_members_that_end_before_do_not_take_the_others_along():
    system, start = henon_heiles(), escaping()
    sweep = vi.ensemble(system, at=TIMES, **start)
    assert sweep.failed.tolist() == [1, 3] and sweep.completed.tolist() == [0, 2, 4]
    assert np.isnan(sweep.error_estimate[[1, 3]]).all()
    for i in (0, 2, 4):
        alone = vi.simulate(system, q0=start["q0"][i], v0=start["v0"][i], at=TIMES)
        assert sweep.q[i].tobytes() == alone.q.tobytes()
    for i in (1, 3):
        words, good = dict(q0=start["q0"][i], v0=start["v0"][i]), sweep.good[i]
        with pytest.raises(vi.ConvergenceError) as caught:
            vi.simulate(system, duration=10.0, **words)
        assert str(sweep.errors[i]) == str(caught.value) and "the motion ends at" in str(
            caught.value
        )
        assert TIMES[good - 1] <= caught.value.time < TIMES[good]
        assert sweep.q.mask[i, good:].all() and not sweep.q.mask[i, :good].any()
        motion = sweep[i]
        np.testing.assert_array_equal(motion.t, TIMES[:good])
        assert motion.q.tobytes() == sweep.q[i, :good].data.tobytes()
        before = vi.simulate(system, at=TIMES[: good - 1], tol=1e-11, **words).q
        np.testing.assert_allclose(motion.q[:-1], before, atol=1e-9 * np.abs(before).max())
    assert sweep.mean(system.q[0]).shape == (101,)
    late = vi.ensemble(system, at=[9.0, 10.0], **start)
    assert late.good.tolist() == [2, 0, 2, 0, 2] and len(late[1]) > 100
    assert late.energy.mask[1].all() and [len(x) for x in late.values(system.q)] == [2, 0, 2, 0, 2]


def test_members_out_of_reach_are_told_in_one_warning():
    """Errors of a chaotic motion grow beyond any tolerance; those of small oscillations do not."""
    q0 = np.array([[0.01, 0.02], [2.0, 2.5], [0.02, 0.01], [2.0, 2.6], [2.1, 2.5]])
    start = dict(v0=[0, 0], duration=25.0)
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        sweep = vi.ensemble(double_pendulum(), q0=q0, **start)
    far, worst = np.flatnonzero(sweep.error_estimate > 1e-9), int(np.argmax(sweep.error_estimate))
    assert len(heard) == 1 and far.tolist() == [1, 3, 4] and not len(sweep.failed)
    text = str(heard[0].message)
    assert text.startswith(f"3 members, [1, 3, 4]; of member {worst}: tol=1e-09 is out of reach")
    assert f"{sweep.error_estimate[worst]:.1e}" in text and heard[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert sweep[worst].stats["error_estimate"] == sweep.error_estimate[worst]
        assert sweep[worst].q.tobytes() == sweep.q[worst].tobytes()
    with pytest.warns(UserWarning, match=r"^member 1: tol=1e-09 is out of reach"):
        vi.ensemble(double_pendulum(), q0=q0[:3], **start)


def test_redundant_rows_are_told_once():
    q, v = vi.coordinates("x", "y")
    rows = ca.vertcat(ca.sumsqr(q) - 1, 2 * ca.sumsqr(q) - 2)
    system = vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[1], constraint=rows)
    q0 = np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1)
    with pytest.warns(UserWarning, match=r"^4 members, \[0, 1, 2, 3\]; .* redundant") as heard:
        sweep = vi.ensemble(system, q0=q0, v0=[0, 0], duration=1.0)
    assert len(heard) == 1 and sweep[2].q.tobytes() == sweep.q[2].tobytes()


REFUSED = {
    "at of an ensemble goes with steps that are chosen": dict(h=0.1, steps=3, at=[1.0]),
    "at and tol of an ensemble goes with": dict(h=0.1, steps=3, at=[1.0], tol=1e-3),
    "give duration or at": dict(),
    "save_every goes with h or steps": dict(duration=1.0, save_every=2),
    "save_every must be": dict(duration=1.0, save_every=ca.MX.sym("n")),
    "tol must be a relative error between 0 and 1, got 2": dict(duration=1.0, tol=2),
    "^tol is the wanted error relative to the motion": dict(duration=1.0, tol=1e-20),
    "at must be times that go on from t0": dict(at=[1.0, 0.5]),
    "do not lie within the run, which takes 1": dict(at=[0.5, 2.0], duration=1.0),
    "duration must not be zero": dict(duration=0.0),
    "duration must be finite": dict(duration=np.inf),
    "two of h, steps, duration": dict(h=0.1),
    "a time or several": dict(at=[[1.0, 2.0]]),
    "t0 must be a number": dict(duration=1.0, t0="now"),
    "u was given, but the system has no control": dict(duration=1.0, u=1.0),
    "unknown backend 'native'": dict(duration=1.0, backend="native"),
}


@pytest.mark.parametrize("message", REFUSED)
def test_what_makes_no_sense_is_refused(message):
    with pytest.raises(vi.InputError, match=message):
        vi.ensemble(swinging(), q0=[0.1, 0.2], v0=0.0, **REFUSED[message])


def test_controls_that_may_be_two_things_are_refused():
    start = dict(q0=np.ones((5, 2)), v0=[0, 0], duration=1.0)
    with pytest.raises(vi.InputError, match=r"give it as \(1, 5, 1\) or as \(5, 1, 1\)"):
        vi.ensemble(pushed(), u=np.ones(5), **start)
    with pytest.raises(vi.InputError, match=r"u has shape \(5, 3\); where steps are chosen"):
        vi.ensemble(pushed(), u=np.ones((5, 3)), **start)
    with pytest.raises(vi.InputError, match=r"\{'q0': 5, 'u': 4\}"):
        vi.ensemble(pushed(), u=PUSH, **start)
    with pytest.raises(vi.InputError, match="u is not finite"):
        vi.ensemble(pushed(), u=np.full((5, 1, 1), np.nan), **start)
    steady = vi.ensemble(pushed(), u=np.arange(5.0).reshape(5, 1, 1), **start)
    table = vi.ensemble(pushed(), u=np.arange(5.0).reshape(1, 5, 1), **start)
    assert np.ptp(steady.q[:, -1, 0]) > 0.1 and np.ptp(table.q[:, -1, 0]) == 0


@pytest.mark.parametrize("wrong", ["q0", "v0"])
def test_a_bad_start_is_refused_before_a_member_moves(wrong, monkeypatch):
    from varint.ensembles import executor

    monkeypatch.setattr(executor, "step_chunk", lambda *_: pytest.fail("a member was stepped"))
    q0 = np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1)
    start = dict(q0=q0, v0=np.zeros((4, 2)))
    start[wrong][2] = [0.1, 0.7]
    with pytest.raises(vi.InputError, match=r"member 2: (q0|v0) violates"):
        vi.ensemble(circle(), duration=1.0, **start)


@pytest.mark.filterwarnings("ignore:2 members, .* degenerate")
@pytest.mark.filterwarnings("ignore:the Lagrangian is degenerate")
@pytest.mark.parametrize(
    "name",
    [
        "acrobot",
        "bouncing_ball",
        "falling_ladder",
        "four_bar",
        "guiding_centre",
        "heavy_top_quaternion",
        "kapitza_pendulum",
        "kicked_rotor",
        "linear_drag",
        "lotka_volterra",
        "magnetic_mirror",
        "pythagorean_three_body",
        "rolling_disc",
        "slack_string",
        "toda_chain",
        "turntable",
        "uniform_fields",
    ],
)
def test_members_of_every_kind_of_scene_are_what_simulate_makes_of_them(name):
    model = getattr(vi.models, name)()
    start = {x: model.start[x] for x in ("v0", "p0", "t0", "u", "params") if x in model.start}
    q0, t0 = np.atleast_1d(np.asarray(model.start["q0"], dtype=float)), start.get("t0", 0.0)
    how = dict(at=t0 + np.linspace(0, 1.5, 7), tol=1e-6)
    alone = vi.simulate(model.system, q0=q0, **how, **start)
    twice = vi.ensemble(model.system, q0=np.stack([q0, q0]), **how, **start)
    assert twice.q.tobytes() == alone.q.tobytes() * 2 and twice.p.tobytes() == alone.p.tobytes() * 2
    assert twice.error_estimate.tolist() == [alone.stats["error_estimate"]] * 2
    np.testing.assert_allclose(twice.energy[1], alone.energy, rtol=1e-12, atol=1e-12)
