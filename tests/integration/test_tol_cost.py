"""What `tol` costs, and that it follows the scene: two runs where the energy tells their errors."""

import json
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.codegen.two_runs import NOT_SHORT
from varint.integration import plain_trials, short_call, tolerance
from varint.integration.error_scale import error_scales
from varint.integration.time_transformation import plain_course
from varint.integration.time_transformation.plain_course import _plain

PLEIADES = json.loads((Path(__file__).parents[1] / "reference" / "f.json").read_text())


def run(model, tol, **more):
    start = dict(q0=model.q0, v0=model.v0, duration=model.duration, backend="interpreted")
    return vi.simulate(model.system, tol=tol, **start | more)


def error(motion, q):
    return float((np.abs(motion.q - q) / error_scales(motion.system, motion)).max())


@pytest.mark.parametrize("tol", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("e", [0.9, 0.99])
def test_steps_follow_an_orbit_from_both_ends_and_the_promise_holds(e, tol):
    model = vi.models.kepler(e=e)
    near = run(model, tol, duration=6 * np.pi)
    assert error(near, model.exact(near.t)[0]) <= tol
    far = dict(q0=[-(1 + e), 0.0], v0=[0.0, -np.sqrt((1 - e) / (1 + e))])
    distant = run(model, tol, duration=6 * np.pi, **far)
    assert error(distant, model.exact(distant.t + np.pi)[0]) <= tol
    for motion in (near, distant):
        assert motion.stats["error_estimate"] <= tol
        assert motion.t[-1] == pytest.approx(6 * np.pi, rel=1e-15)
        assert motion.fictitious is not None and len(motion) <= 3 * 40


ALIKE = {  # with steps that follow the scene, by numbers alone
    "near": (vi.models.kepler(e=0.9), {"duration": 40 * np.pi}),
    "backwards": (vi.models.kepler(e=0.9), {"duration": -11.0}),
    "with a scale": (vi.models.kepler(e=0.95), {"duration": 30.0, "scale": 2.0}),
    "lost at first": (vi.models.kepler(e=0.99), {"duration": 6 * np.pi, "t0": 1.5}),
    "three bodies": (vi.models.arenstorf(), {}),
}


@pytest.mark.parametrize("tol", [1e-3, 1e-9])
@pytest.mark.parametrize("case", ALIKE)
def test_runs_that_follow_the_scene_are_the_same_by_numbers_alone(monkeypatch, case, tol):
    model, more = ALIKE[case]
    plainly = []

    def watched(*given):
        plainly.append(found := _plain(*given))
        return found

    monkeypatch.setattr(plain_course, "_plain", watched)
    short = run(model, tol, backend="native", **more)
    monkeypatch.setattr(plain_course, "_plain", lambda *_: None)
    long = run(model, tol, backend="native", **more)
    assert any(plainly) and short.fictitious is not None
    for one, other in ((short, long), (short.fictitious, long.fictitious)):
        for name in "tqp":  # the last step is solved no further than the others, or to round-off
            near = getattr(one, name), getattr(other, name)
            assert np.array_equal(*(x[:-1] for x in near))
            assert near[0][-1] == pytest.approx(near[1][-1], rel=1e-11, abs=max(1e-3 * tol, 1e-11))
        for name in "khc":
            assert np.array_equal(getattr(one, name), getattr(other, name))
        told = "plan", "backend"
        assert [one.stats[name] for name in told] == [other.stats[name] for name in told]
    told = "tol", "rule", "runs"
    assert [short.stats[name] for name in told] == [long.stats[name] for name in told]
    estimates = short.stats["error_estimate"], long.stats["error_estimate"]
    assert estimates[0] == pytest.approx(estimates[1], rel=1e-2, abs=1e-13)
    between = short.t[:-2] + 0.3 * np.diff(short.t[:-1])
    assert np.array_equal(short.at(between).q, long.at(between).q)


@pytest.mark.parametrize("tol", [1e-3, 1e-6])
def test_what_iterations_leave_is_not_taken_for_steps_that_are_too_large(tol):
    """It grows in encounters: seven runs before, of up to 1,420 steps."""
    model = vi.models.kepler(e=0.999)
    motion = run(model, tol, duration=60.0)
    assert error(motion, model.exact(motion.t)[0]) <= tol
    assert motion.stats["runs"] <= 4 and len(motion) < 500


@pytest.mark.parametrize("tol", [1e-6, 1e-9])
def test_a_satellite_of_earth_and_moon_is_back_within_tol_after_a_hundred_steps(tol):
    model = vi.models.arenstorf()
    motion = run(model, tol)
    scales = error_scales(model.system, motion)
    assert (np.abs(motion.q[-1] - model.q0) / scales).max() <= tol
    assert motion.fictitious is not None and len(motion) < 130


@pytest.mark.long
@pytest.mark.parametrize("tol", [1e-3, 1e-6, 1e-9])
def test_seven_stars_are_where_the_published_solution_has_them_within_tol(tol):
    model = vi.models.pleiades()
    motion = run(model, tol, backend="compiled")
    true = np.array(PLEIADES["F01_pleiades"]["reference"]["state"][0])
    assert (np.abs(motion.q[-1] - true) / error_scales(model.system, motion)).max() <= tol
    assert len(motion) < 120


@pytest.mark.parametrize("duration, tol", ((4.0, 1e-9), (5.0, 1e-10)))
def test_three_runs_that_agree_prove_an_error_whose_energies_are_round_off(duration, tol):
    """Near the halo orbit of an unstable point errors grow; 91 and 204 steps, 4 and 5 runs before,
    for the energies of the second run were round-off, which the third had more of."""
    q, v = vi.coordinates("x", "y", "z")
    mu = 0.01215
    earth, moon = ca.vertcat(-mu, 0, 0), ca.vertcat(1 - mu, 0, 0)
    turning = q[0] * v[1] - q[1] * v[0] + ca.sumsqr(q[:2]) / 2
    pull = (1 - mu) / ca.norm_2(q - earth) + mu / ca.norm_2(q - moon)
    system = vi.System(q, v, ca.sumsqr(v) / 2 + turning + pull)
    start = {"q0": [0.8234, 0.0, 0.0224], "v0": [0.0, 0.1343, 0.0]}
    motion = vi.simulate(system, **start, duration=duration, tol=tol)
    assert motion.stats["runs"] <= 3 and motion.stats["steps"] < 100
    fine = vi.simulate(system, vi.gauss(8), **start, h=duration / 16000, steps=16000)
    assert np.abs(motion.q[-1] - fine.q[-1]).max() < tol


@pytest.mark.long
@pytest.mark.parametrize("tol", [1e-6, 1e-9])
def test_three_bodies_from_rest_are_followed_through_their_encounters(tol):
    model = vi.models.pythagorean_three_body()
    motion = run(model, tol, backend="compiled")
    start = dict(q0=model.q0, v0=model.v0, duration=10.0, h=0.2, time_scale="auto")
    tight = vi.simulate(model.system, vi.gauss(10), **start)
    assert error(motion, tight.at(motion.t).q) <= tol


@pytest.mark.parametrize(
    ("name", "duration", "tol"),
    [
        ("kepler", 100 * np.pi, 1e-6),
        ("kepler", 100 * np.pi, 1e-9),
        ("henon_heiles", 500.0, 1e-9),
        ("pendulum", 200.0, 1e-9),
    ],
)
@pytest.mark.parametrize("backend", ["native", "interpreted"])
def test_all_runs_together_take_at_most_three_quarters_more_steps_than_the_last(
    monkeypatch, backend, name, duration, tol
):
    counted = []

    def counting(run):
        def counted_run(system, chosen, problem, *rest, **more):
            counted.append(problem.steps)
            return run(system, chosen, problem, *rest, **more)

        return counted_run

    # which take the same runs
    monkeypatch.setattr(short_call, "short_call", lambda *_: None)
    monkeypatch.setattr(tolerance, "by_short_trials", lambda *_: NOT_SHORT)
    for module, loop in ((tolerance, "start_run"), (plain_trials, "run_at_once")):
        monkeypatch.setattr(module, loop, counting(getattr(module, loop)))
    model = vi.models.catalogue[name]()
    motion = run(model, tol, duration=duration, backend=backend)
    assert len(counted) > 1 and counted[-1] == motion.k[-1]
    assert sum(counted) <= 1.75 * motion.k[-1]
    if model.exact:
        assert error(motion, model.exact(motion.t)[0]) <= tol


def test_crossings_saved_nodes_and_other_times_are_as_with_equal_steps():
    model = vi.models.kepler(e=0.9)
    y = model.system.q[1]
    motion = run(model, 1e-9, duration=20.0, until=(y, -1))
    assert motion.fictitious is not None
    assert motion.t[-1] == pytest.approx(np.pi, abs=1e-8)
    motion = run(model, 1e-9, duration=20.0, events={"apse": (y, -1)}, save_every=5)
    times = [event.time for event in motion.events]
    assert times == pytest.approx([np.pi, 3 * np.pi, 5 * np.pi], abs=1e-8)
    every = run(model, 1e-9, duration=20.0)
    assert len(motion) < len(every) / 4 and motion.t[-1] == pytest.approx(20.0, rel=1e-15)
    grid = np.linspace(0, 20, 77)
    assert np.abs(every.at(grid).q - model.exact(grid)[0]).max() < 1e-7
    estimate = every.stats["error_estimate"]  # and what the run with events is apart by
    assert motion.stats["error_estimate"] == pytest.approx(estimate, rel=1e-2)


def test_what_needs_equal_steps_gets_them():
    model = vi.models.kepler(e=0.8)
    explicit = run(model, 1e-6, duration=6.0, rule=vi.composition("kahan-li8"))
    assert explicit.fictitious is None
    assert error(explicit, model.exact(explicit.t)[0]) <= 1e-6


def test_steps_that_are_chosen_are_solved_whatever_is_to_be_done_about_others():
    model = vi.models.kepler(e=0.8)
    plain, divided = (
        run(model, 1e-6, duration=6.0, **asked) for asked in ({}, {"on_failure": "subdivide"})
    )
    assert divided.fictitious is not None and divided.q.tobytes() == plain.q.tobytes()
    with pytest.raises(vi.InputError, match="on_failure must be 'raise' or 'subdivide'"):
        run(model, 1e-6, duration=6.0, on_failure="go on")


@pytest.mark.parametrize("rows", [3, 30, 300])
def test_a_table_of_controls_takes_the_steps_that_its_rows_ask_for(rows):
    """A row a time unit, in which the pendulum turns by π."""
    q, v = vi.coordinates("theta")
    u = ca.SX.sym("u")
    scene = vi.System(q, v, v**2 / 2 + np.pi**2 * ca.cos(q), control=u, force=u - 0.1 * v)
    table = np.random.default_rng(rows).uniform(-1, 1, (rows, 1))
    asked = {"q0": 0.5, "v0": 0.0, "duration": float(rows)}
    motion = vi.simulate(scene, **asked, u=table, tol=1e-6)
    fine = vi.simulate(scene, vi.gauss(8), **asked, steps=16 * rows, u=table.repeat(16, axis=0))
    assert motion.stats["steps"] % rows == 0 and motion.stats["steps"] <= 40 * rows
    assert np.abs(motion.q[-1] - fine.q[-1]).max() <= 1e-6 * np.ptp(motion.q)


@pytest.mark.parametrize("tol", [1e-3, 1e-4])
def test_a_potential_with_a_kink_is_met_by_the_shrinkage_that_shows(tol):
    q, v = vi.coordinates("x")
    system = vi.System(q, v, v**2 / 2 - ca.fabs(q))
    motion = vi.simulate(system, q0=0.5, v0=0.0, duration=6.0, tol=tol)
    quarter = 1.0  # of the period: ½ t² = ½
    t = (motion.t % 4) / quarter
    fall = np.where(t <= 1, 0.5 - t**2 / 2, np.where(t <= 3, (t - 2) ** 2 / 2 - 0.5, 0))
    true = np.where(t > 3, 0.5 - (4 - t) ** 2 / 2, fall)
    assert np.abs(motion.q[:, 0] - true).max() <= tol
    assert motion.stats["error_estimate"] <= tol


def test_a_scene_that_rests_where_its_forces_vanish_meets_every_tolerance():
    """Its range is round-off, and no measure of anything."""
    q, v = vi.coordinates("theta")
    hoop = vi.System(q, v, (v**2 + 36 * ca.sin(q) ** 2) / 8 + 4.905 * ca.cos(q))
    rest = np.arccos(9.81 / 18)
    motion = vi.simulate(hoop, q0=rest, v0=0.0, duration=5.0)
    assert np.abs(motion.q - rest).max() < 1e-13 and motion.stats["error_estimate"] < 1e-9
