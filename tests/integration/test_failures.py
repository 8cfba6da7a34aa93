"""The failure contract: step, time, residual, likely cause, what to try, the nodes before; and
the remedy.
"""

from __future__ import annotations

import pickle
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scenes import double_pendulum, pendulum

import varint as vi
from varint.integration import failures, to_tolerance


def failure(system: vi.System, rule: vi.Rule | None = None, **start) -> vi.ConvergenceError:
    with pytest.raises(vi.ConvergenceError) as caught:
        vi.simulate(system, rule, **start)
    error = caught.value
    motion = error.trajectory
    assert error.step == motion.k[-1] and error.time == motion.t[-1]
    assert np.isfinite(motion.q).all() and np.isfinite(motion.p).all()
    assert "try a smaller h" in str(error) or "start elsewhere" in str(error)
    return error


def kepler(**extras) -> vi.System:
    q, v = vi.coordinates("x", "y")
    return vi.System(
        q,
        v,
        ca.sumsqr(v) / 2 + 1 / ca.norm_2(q),
        **{name: make(q) for name, make in extras.items()},
    )


@pytest.mark.parametrize("backend", ["auto", "compiled", "interpreted"])
def test_momenta_overflow_as_coordinates_do(backend):
    """The last kick of an explicit step was not looked at: its momentum was −inf in the result."""
    q, v = vi.coordinates("x")
    system = vi.System(q, v, v**2 / 2 - q**2)
    start = dict(q0=1.0, v0=0.0, h=717397458.0, backend=backend)
    with np.errstate(all="ignore"):
        failure(system, vi.composition("blanes-moan4"), **start, steps=3)


@pytest.mark.parametrize("backend", ["interpreted", "compiled"])
@pytest.mark.parametrize("rule", [vi.gauss(2), vi.composition("verlet")], ids=str)
def test_a_square_root_of_a_negative_number_is_named(rule, backend):
    q, v = vi.coordinates("x")
    root = vi.System(q, v, v**2 / 2 - q + ca.sqrt(q))
    error = failure(root, rule, q0=1.0, v0=-3.0, h=0.01, steps=1000, backend=backend)
    assert "not defined where the step leads" in error.cause
    assert 0.2 < error.time < 0.6


def test_a_near_collision_is_named():
    error = failure(kepler(), vi.gauss(2), q0=[1, 0], v0=[0, 1e-4], h=0.01, steps=1000)
    assert "collision or near approach" in error.cause
    assert 1.0 < error.time < 1.2  # free fall takes π/√8


def test_a_step_too_large_for_the_fastest_motion_is_named_with_h_omega():
    q, v = vi.coordinates("x")
    stiff = vi.System(q, v, v**2 / 2 - 1e4 * ca.cosh(q))
    error = failure(stiff, vi.lobatto(3), q0=4.0, v0=0.0, h=1.0, steps=100)
    assert "h is too large for the fastest motion (h ω" in error.cause


def test_a_pole_of_the_coordinates_is_named():
    """A spherical pendulum that runs close past the pole θ = 0 of its angles."""
    q, v = vi.coordinates("theta", "phi")
    kinetic = (v[0] ** 2 + ca.sin(q[0]) ** 2 * v[1] ** 2) / 2
    system = vi.System(q, v, kinetic + 9.81 * ca.cos(q[0]))
    start = {"q0": [0.5, 0], "v0": [-1, 0.1], "h": 0.03, "steps": 200}
    error = failure(system, vi.lobatto(3), **start, backend="interpreted")
    assert "the inertia of ['phi'] vanishes" in error.cause


def test_a_folded_linkage_is_named():
    q, v = vi.coordinates("x1", "y1", "x2", "y2")
    rods = ca.vertcat(
        ca.sumsqr(q[:2]) - 1,
        ca.sumsqr(q[2:] - q[:2]) - 1,
        ca.sumsqr(q[2:] - ca.DM([2.0, 0])) - 1e-16,
    )
    system = vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * (q[1] + q[3]), constraint=rods[:2])
    motion = vi.simulate(system, q0=[1, 0, 2, 0], v0=[0, 0, 0, 0], h=1e-3, steps=1)

    from varint.integration.failures import likely_cause

    stretched = vi.System(q, v, ca.sumsqr(v) / 2, constraint=rods)
    cause = likely_cause(replace(motion[:1], system=stretched, active_set=None))
    assert "singular configuration (the gradients of the constraint rows [" in cause


def test_a_four_bar_linkage_at_its_dead_point_is_refused_with_its_rows():
    """A parallelogram folded flat may go on as one or as an antiparallelogram: the motion is not
    determined.
    """
    q, v = vi.coordinates("x1", "y1", "x2", "y2")
    bars = ca.vertcat(
        ca.sumsqr(q[:2]) - 1, ca.sumsqr(q[2:] - q[:2]) - 4, ca.sumsqr(q[2:] - ca.DM([2.0, 0])) - 1
    )
    linkage = vi.System(q, v, ca.sumsqr(v) / 2, constraint=bars)
    with pytest.raises(
        vi.InputError, match=r"rows \[0, 1, 2\] are dependent at the start .* folded linkage"
    ):
        vi.simulate(linkage, q0=[1, 0, 3, 0], v0=[0, 1, 0, 1], h=0.01, steps=10)


def test_an_energy_that_nothing_can_change_raises_the_alarm():
    """A double pendulum thrown at 8 rad/s with h = 0.15 takes roots of its equations that are
    none of the motion's.
    """
    with pytest.warns(UserWarning, match=r"the energy went from 36\.55.* h = 0.15 is too large"):
        vi.simulate(double_pendulum(), vi.gauss(2), q0=[0.4, -0.3], v0=[8, 0], h=0.15, steps=10)
    with pytest.warns(UserWarning, match="the energy went"):  # Verlet beyond h ω = 2
        vi.simulate(pendulum(), vi.trapezoidal(), q0=0.1, v0=0.0, h=2.2, steps=20)
    vi.simulate(double_pendulum(), vi.gauss(2), q0=[0.4, -0.3], v0=[8, 0], h=0.05, steps=100)


@pytest.mark.parametrize("every", [1, 7, 100])
def test_dividing_a_step_that_fails_passes_the_near_collision(every):
    start = dict(q0=[1, 0], v0=[0, 0.1], h=0.02, steps=60)
    failure(kepler(), vi.gauss(4), **start)
    motion = vi.simulate(kepler(), vi.gauss(4), save_every=every, on_failure="subdivide", **start)
    (event,) = motion.events
    parts = int(event.kind.removeprefix("divided in "))
    inside = (motion.t > event.time - 1e-9) & (motion.t < event.time + 0.02 + 1e-9)
    assert event.time == pytest.approx(1.1) and inside.sum() == parts + 1
    assert abs(event.energy_after - event.energy_before) < 1e-11
    spin = motion.value(
        motion.system.q[0] * motion.system.v[1] - motion.system.q[1] * motion.system.v[0]
    )
    np.testing.assert_allclose(spin, 0.1, atol=1e-13)
    assert set(range(0, 61, every)) <= set(motion.k.tolist()) and (np.diff(motion.t) > 0).all()
    within = motion.t[inside]
    between = motion.at((within[1:] + within[:-1]) / 2)  # dense output follows the parts
    np.testing.assert_allclose(between.energy, event.energy_before, atol=1e-9)


def test_a_run_that_need_not_be_divided_is_left_alone():
    start = dict(q0=[0.4, 0.2], v0=[0, 0], h=0.05, steps=500)
    plain = vi.simulate(double_pendulum(), vi.gauss(3), **start)
    safe = vi.simulate(double_pendulum(), vi.gauss(3), on_failure="subdivide", **start)
    assert safe.events == () and safe.q.tobytes() == plain.q.tobytes()


@pytest.mark.parametrize("every", [1, 7])
def test_a_step_with_contacts_is_divided_and_an_impact_in_it_is_found(every):
    """A wall behind the centre is hit within the step that cannot be solved."""
    walled = kepler(contact=lambda q: q[0] + 0.004, restitution=lambda q: 0.8)
    start = dict(q0=[0.9, 0], v0=[0, 0.1])
    failure(walled, vi.lobatto(6), h=0.015, steps=90, **start)
    motion = vi.simulate(
        walled, vi.lobatto(6), h=0.015, steps=90, save_every=every, on_failure="subdivide", **start
    )
    fine = vi.simulate(walled, vi.lobatto(6), h=1.5e-5, steps=90_000, save_every=1000, **start)
    (divided, impact), (exact,) = motion.events, fine.events
    assert divided.kind == "divided in 512" and divided.time == pytest.approx(0.945)
    assert impact.kind == "impact" and impact.time == pytest.approx(exact.time, abs=5e-6)
    assert impact.energy_after - impact.energy_before == pytest.approx(
        exact.energy_after - exact.energy_before, rel=2e-3
    )
    assert motion.value(motion.system.contact).min() > -1e-15
    inside = (motion.t > 0.945 - 1e-9) & (motion.t < 0.96 + 1e-9)
    assert inside.sum() == 512 + 2 and (np.diff(motion.t) > 0).all(), "512 parts and the impact"
    assert set(range(0, 91, every)) <= set(motion.k.tolist())
    np.testing.assert_allclose(motion.q[-1], fine.q[-1], atol=2e-3)
    within = motion.t[inside]
    between = motion.at((within[1:] + within[:-1]) / 2)
    # of −1.1 + 250
    np.testing.assert_allclose(between.energy, motion.at(within[:-1]).energy, atol=1e-2)


def test_a_contact_that_nothing_can_divide_fails_with_the_nodes_before_it():
    """The gap √x has no number behind the wall."""
    q, v = vi.coordinates("x")
    system = vi.System(q, v, v**2 / 2 - q, contact=ca.sqrt(q))
    for more in ({}, dict(on_failure="subdivide")):
        error = failure(system, q0=1.0, v0=0.0, h=0.01, steps=300, **more)
        assert "the gap of a contact is not defined where the step leads" in error.cause
        assert error.time == pytest.approx(np.sqrt(2), abs=0.01)


def test_what_makes_a_later_step_impossible_comes_with_the_nodes_before_it():
    """A gap without gradient closes: no impulse can open it. The other members of an ensemble go
    on.
    """
    q, v, t = *vi.coordinates("x"), vi.time()
    system = vi.System(q, v, v**2 / 2, contact=1 - t + 0 * q, t=t)
    with pytest.raises(
        vi.ConvergenceError, match=r"cannot be done: contact 0 closes at t = 1 .*no gradient"
    ) as caught:
        vi.simulate(system, q0=1.0, v0=1.0, h=0.1, steps=30)
    assert len(caught.value.trajectory) == 11 and caught.value.step == 10
    with pytest.raises(vi.InputError, match="no gradient"):
        vi.simulate(system, q0=1.0, v0=1.0, h=0.1, steps=30, t0=1.0)
    ball = vi.System(q, v, v**2 / 2 - 9.81 * q, contact=q, restitution=0.5)
    motions = vi.ensemble(ball, q0=[1.0, 9.0], v0=0.0, h=-0.01, steps=100)
    assert motions.failed.tolist() == [0] and "run backwards" in str(motions.errors[0])
    np.testing.assert_allclose(motions.q[1, :, 0], 9 - 9.81 * motions.t**2 / 2, atol=1e-12)


@pytest.mark.parametrize("rule", [vi.gauss(4), vi.lobatto(5)], ids=str)
def test_controls_at_the_nodes_of_a_divided_step_are_a_polynomial_of_time(rule):
    """A push that grows with time, given at the nodes, moves as the same push written into the
    scene does.
    """
    start, t = dict(q0=[1, 0], v0=[0, 0.1], h=0.02, steps=75, on_failure="subdivide"), vi.time()
    q, v = vi.coordinates("x", "y")
    push, free = ca.SX.sym("push"), ca.sumsqr(v) / 2 + 1 / ca.norm_2(q)
    given = vi.System(q, v, free, force=ca.vertcat(push, 0), control=push)
    written = vi.System(q, v, free, force=ca.vertcat(0.1 * t**2, 0), t=t)
    u = 0.1 * (0.02 * (np.arange(75)[:, None] + np.array(rule.nodes)))[..., None] ** 2
    one, other = vi.simulate(given, rule, u=u, **start), vi.simulate(written, rule, **start)
    assert [e.kind for e in one.events] == [e.kind for e in other.events] and one.events
    before = one.t < one.events[0].time + 0.021
    np.testing.assert_allclose(one.q[before], other.q[before], atol=1e-8)
    between = one.t[before][:-1] + np.diff(one.t[before]) / 3
    np.testing.assert_allclose(one.at(between).q, other.at(between).q, atol=1e-8)


@pytest.mark.parametrize("every", [1, 10])
def test_a_compiled_run_is_divided_as_an_interpreted_one(every, tmp_path, monkeypatch):
    """And goes on compiled; from its checkpoint, too."""
    from varint.integration import checkpoint, compiled_loop

    monkeypatch.setattr(checkpoint, "PAUSE", 0.0)
    monkeypatch.setattr(checkpoint, "MOST_SHARE", 1e9)
    monkeypatch.setattr(compiled_loop, "NODES_IN_BLOCK", 50)
    start = dict(q0=[1, 0], v0=[0, 0.1], h=0.02, steps=60, save_every=every, on_failure="subdivide")
    plain = vi.simulate(kepler(), vi.gauss(4), backend="interpreted", **start)
    fast = vi.simulate(kepler(), vi.gauss(4), backend="compiled", **start)
    assert (
        fast.stats["backend"].startswith("compiled") and fast.events[0].kind == plain.events[0].kind
    )
    np.testing.assert_array_equal(fast.t, plain.t)
    np.testing.assert_allclose(fast.q, plain.q, atol=1e-11)
    start |= dict(backend="compiled", steps=400)
    whole, calls, write = (
        vi.simulate(kepler(), vi.gauss(4), **start),
        [],
        checkpoint.Checkpoint.write,
    )

    def stopped(self, *arguments):
        write(self, *arguments)
        calls.append(1)
        if len(calls) == 4:
            raise ZeroDivisionError

    with monkeypatch.context() as patch, pytest.raises(ZeroDivisionError):
        patch.setattr(checkpoint.Checkpoint, "write", stopped)
        vi.simulate(kepler(), vi.gauss(4), checkpoint=tmp_path / "run", **start)
    again = vi.simulate(kepler(), vi.gauss(4), checkpoint=tmp_path / "run", **start)
    assert again.q.tobytes() == whole.q.tobytes() and again.events == whole.events


def test_an_energy_that_impacts_do_not_explain_raises_the_alarm():
    """Much too large a step by a wall; a ball whose impacts take energy is no reason."""
    walled = kepler(contact=lambda q: q[0] + 0.003, restitution=lambda q: 1.0)
    with pytest.warns(
        UserWarning, match="which nothing in the scene can do: h = 0.02 is too large"
    ):
        vi.simulate(walled, vi.lobatto(4), q0=[1, 0], v0=[0, 0.1], h=0.02, steps=300)
    q, v = vi.coordinates("x", "y")
    ball = vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[1], contact=q[1], restitution=0.3)
    lost = vi.simulate(ball, q0=[0, 1.0], v0=[0.1, 0], h=0.01, steps=300).energy
    assert lost[-1] < 0.01 * lost[0]


def test_what_cannot_be_divided_fails_with_the_nodes_before_it():
    q, v = vi.coordinates("x")
    root = vi.System(q, v, v**2 / 2 - q + ca.sqrt(q))
    error = failure(root, vi.gauss(2), q0=1.0, v0=-3.0, h=0.01, steps=1000, on_failure="subdivide")
    assert "has no solution, nor have 2, 4, … 1024 parts" in str(error)


def test_parts_that_never_agree_are_no_solution():
    """A fall into the centre: 1024 parts of the step are solved, each number of them otherwise."""
    error = failure(
        kepler(), vi.gauss(4), q0=[1, 0], v0=[0, 1e-5], h=0.01, steps=200, on_failure="subdivide"
    )
    assert "one on which they agree" in str(error) and "collision" in error.cause
    assert error.time == pytest.approx(1.11)


def test_remedies_that_do_not_exist_are_refused():
    start = dict(q0=1.0, v0=0.0, h=0.1, steps=10)
    with pytest.raises(vi.InputError, match="'raise' or 'subdivide', got 'retry'"):
        vi.simulate(pendulum(), on_failure="retry", **start)


def test_errors_travel_between_processes():
    error = failure(kepler(), vi.gauss(2), q0=[1, 0], v0=[0, 1e-4], h=0.01, steps=1000)
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again), again.step, again.cause) == (
        type(error),
        str(error),
        error.step,
        error.cause,
    )
    solver = pickle.loads(pickle.dumps(vi.SolverError("no", status="Infeasible")))
    assert (str(solver), solver.status) == ("no", "Infeasible")


def test_progress_shows_rate_and_energy_error_and_is_silent_when_not_wanted(capsys):
    start = dict(q0=[0.4, 0.2], v0=[0, 0], h=0.01, steps=20_000, backend="interpreted")
    vi.simulate(double_pendulum(), vi.gauss(2), progress=True, **start)
    shown = capsys.readouterr().err
    assert "step/s" in shown and "ΔH/|H|=" in shown
    vi.simulate(double_pendulum(), vi.gauss(2), progress=False, **start)
    vi.simulate(double_pendulum(), vi.gauss(2), **start)  # no terminal: nobody watches
    assert capsys.readouterr().err == ""


def test_progress_of_a_run_that_ends_early_shows_the_steps_until_there(capsys):
    system = double_pendulum()
    start = dict(q0=[0.4, 0.2], v0=[0, 0], h=1e-3, steps=1000, until=system.q[0])
    motion = vi.simulate(system, progress=True, **start)
    shown = capsys.readouterr().err
    assert 100 < motion.k[-1] < 900 and f"{motion.k[-1] + 1}/1.00k" in shown


@pytest.mark.parametrize("rule", [None, vi.midpoint()], ids=["default", "midpoint"])
def test_an_energy_that_is_no_number_is_told_from_a_step_too_large(rule):
    """The force of log x goes on behind x = 0, the Lagrangian does not; √x is left by the
    midpoint rule's last step.
    """
    q, v = vi.coordinates("x")
    with pytest.warns(
        UserWarning,
        match=r"the energy is not defined near q = \[-.* logarithm of a negative number",
    ):
        vi.simulate(
            vi.System(q, v, v**2 / 2 - q + ca.log(q) / 100),
            rule,
            q0=1.0,
            v0=-3.0,
            h=0.01,
            steps=100,
        )
    root = failure(
        vi.System(q, v, v**2 / 2 - q + ca.sqrt(q)),
        vi.midpoint(),
        q0=1.0,
        v0=-3.0,
        h=0.01,
        steps=1000,
    )
    assert root.cause.startswith("the energy is not defined near q = [-")


def test_a_lagrangian_that_ends_at_a_time_is_named():
    q, v, t = *vi.coordinates("x"), vi.time()
    error = failure(
        vi.System(q, v, v**2 / 2 - q**2 * ca.log(1 - t), t=t), q0=1.0, v0=0.0, h=0.01, steps=200
    )
    assert "not defined where the step leads" in error.cause and "at t = 1 " in error.cause


def test_a_constraint_that_loses_its_gradient_is_named():
    """The cusp of x² = y³."""
    q, v = vi.coordinates("x", "y")
    cusp = vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[1], constraint=q[0] ** 2 - q[1] ** 3)
    error = failure(cusp, q0=[1, 1], v0=[0, 0], h=0.01, steps=300)
    assert "the gradients of the constraint rows [0] nearly vanish" in error.cause


def test_an_energy_that_is_no_number_far_away_is_told_without_a_warning_of_numpy():
    """Found by fuzzing: q is 1e305 after one step, and rounding it to six digits overflows."""
    q, v = vi.coordinates("x", "y")
    system = vi.System(q, v, 1e-20 * (ca.sumsqr(v) / 2 - ca.log(q[0])))
    with pytest.warns(
        UserWarning, match=r"the energy is not defined near q = \[-?\d\.\d*e\+30\d, 0\]"
    ):
        vi.simulate(system, q0=[3e-305, 0.0], v0=[0.0, 0.0], h=1.0, steps=1, backend="interpreted")


def test_a_cause_is_looked_for_when_somebody_reads_it(monkeypatch):
    """A search for steps, all equal, has runs that fail, and nobody asks why."""

    def never(*_):
        raise AssertionError("a cause is looked for")

    q, v = vi.coordinates("r", "a")
    polar = vi.System(q, v, (v[0] ** 2 + q[0] ** 2 * v[1] ** 2) / 2 + 1 / q[0])
    motion = {"q0": [1.0, 0.0], "v0": [0.0, 0.1]}
    with pytest.raises(vi.ConvergenceError) as caught:
        vi.simulate(kepler(), vi.gauss(2), **motion, h=1.0, steps=5)
    with monkeypatch.context() as patched:
        patched.setattr(failures, "likely_cause", never)
        patched.setattr(to_tolerance, "choose_varying_steps", lambda *_: None)
        asked = {"duration": 3.0, "tol": 1e-6, "save_every": 2}
        assert vi.simulate(polar, **motion, **asked).stats["runs"] > 3
        with pytest.raises(AssertionError, match="a cause"):
            str(caught.value)
    copy = pickle.loads(pickle.dumps(caught.value))
    assert caught.value.cause in str(caught.value) == str(copy) and copy.cause == caught.value.cause
    assert repr(copy) == repr(caught.value)
