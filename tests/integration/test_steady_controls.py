"""Controls that are the same all the time go the ways of parameters, and come back as controls."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.integration import steady_controls, to_tolerance


def cart(**more) -> vi.System:
    q, v = vi.coordinates("x", "theta")
    push, c = ca.SX.sym("push"), vi.Parameters(g=9.81, control_arm=1.0)
    kinetic = v[0] ** 2 + c.control_arm**2 * v[1] ** 2 / 2
    kinetic += c.control_arm * v[0] * v[1] * ca.cos(q[1])
    force = ca.vertcat(push - 0.3 * v[0], 0)
    lagrangian = kinetic + c.g * c.control_arm * ca.cos(q[1])
    return vi.System(q, v, lagrangian, control=push, force=force, params=c, **more)


START = {"q0": [0.0, 0.4], "v0": [0.0, 0.1]}


@pytest.mark.parametrize("u", [0.7, [0.7], [[0.7]], np.array([0.7])])
def test_a_control_that_stays_the_same_goes_the_short_way(monkeypatch, u):
    system = cart()

    def never(*_, **__):
        raise AssertionError("the long way is taken")

    monkeypatch.setattr(to_tolerance, "simulate_to_tolerance", never)
    motion = vi.simulate(system, **START, duration=4.0, tol=1e-8, u=u, params={"g": 5.0})
    fine = vi.simulate(
        system, vi.gauss(8), **START, duration=4.0, steps=200, u=[0.7], params={"g": 5.0}
    )
    assert motion.system is system and motion.u.shape == (motion.stats["steps"], 1, 1)
    assert (motion.u == 0.7).all() and motion.parameters.keys() == {"g", "control_arm"}
    assert np.abs(motion.q[-1] - fine.q[-1]).max() <= 1e-8 * np.abs(fine.q).max()


def test_what_follows_from_such_a_motion_is_that_of_its_controls(tmp_path):
    system = cart()
    motion = vi.simulate(system, **START, duration=2.0, u=0.7)
    again = vi.simulate(
        system, motion.rule, **START, duration=2.0, steps=motion.stats["steps"], u=[0.7]
    )
    assert np.abs(motion.q - again.q).max() < 1e-11
    assert np.abs(motion.energy - again.energy).max() < 1e-11
    between = [0.3, 1.1]
    assert np.abs(motion.at(between).q - again.at(between).q).max() < 1e-11
    one, other = (vi.gradient(x, terminal_loss=system.q[0]) for x in (motion, again))
    assert np.abs(one.u - other.u).max() < 1e-9
    motion.save(tmp_path / "motion")
    assert vi.load(tmp_path / "motion.npz").u.tobytes() == motion.u.tobytes()


def test_the_ways_to_ask_for_it_agree(tmp_path):
    system, asked = cart(), START | {"duration": 3.0, "u": 0.7}
    motion = vi.simulate(system, **asked)
    for more in ({"progress": True}, {"checkpoint": tmp_path / "run"}, {"u": [0.7]}):
        other = vi.simulate(system, **asked | more)
        assert other.q.tobytes() == motion.q.tobytes() and other.u.tobytes() == motion.u.tobytes()
    table = vi.simulate(system, **asked | {"u": np.full((3, 1), 0.7)})
    assert np.abs(table.q[-1] - motion.q[-1]).max() < 1e-8
    times = np.linspace(0, 3, 5)
    asked_at = vi.simulate(system, **START, at=times, u=0.7)
    assert asked_at.t.tolist() == times.tolist()
    assert np.abs(asked_at.q[-1] - motion.q[-1]).max() < 1e-12


def falling() -> vi.System:
    q, v = vi.coordinates("x")
    push, c = ca.SX.sym("push"), vi.Parameters(control=2.0)
    return vi.System(q, v, c.control * v**2 / 2, force=push, control=push, params=c)


def test_ends_and_events_are_found_on_the_short_way(monkeypatch):
    system = falling()

    def never(*_, **__):
        raise AssertionError("the long way is taken")

    monkeypatch.setattr(to_tolerance, "simulate_to_tolerance", never)
    x, push = system.q, system.control
    asked = {"q0": 1.0, "v0": 0.5, "duration": 4.0, "u": 3.0, "params": {"control": 1.5}}

    def reached(level):  # 1 + t/2 + t² = level
        return (-0.5 + np.sqrt(0.25 + 4 * (level - 1))) / 2

    whole = vi.simulate(system, **asked)
    for until in (x - 7, (x - 7, 1)):
        events = {"double": x - 2 * push / 3, "above": (x - push, 1), "falls": (x - push, -1)}
        motion = vi.simulate(system, **asked, until=until, events=events)
        assert motion.t[-1] == pytest.approx(reached(7.0), abs=1e-9)
        assert [event.kind for event in motion.events] == ["double", "above"]
        times = [event.time for event in motion.events]
        assert times == pytest.approx([reached(2.0), reached(3.0)], abs=1e-9)
        assert motion.system is system and (motion.u == 3).all() and motion.c == [1.5]
        assert motion.q[-1, 0] == pytest.approx(7.0, abs=1e-9)
        assert motion.at(0.7).q[0] == pytest.approx(whole.at(0.7).q[0], abs=1e-9)
    motion = vi.simulate(system, **asked, until=x - 100 * push)
    assert motion.t[-1] == 4.0 and len(motion) == len(motion.u) + 1


def test_ends_and_events_of_unknown_symbols_are_told_in_the_names_of_the_user():
    system, foreign = cart(), ca.SX.sym("control")
    for asked in ({"until": foreign}, {"events": {"met": foreign}}):
        with pytest.raises(vi.InputError, match=r"unknown symbols \['control'\] .*'push'"):
            vi.simulate(system, **START, duration=1.0, u=0.7, **asked)
    for bad in (0.5, ca.SX(2, 1)):
        with pytest.raises(vi.InputError, match="until must be one SX expression"):
            vi.simulate(system, **START, duration=1.0, u=0.7, until=bad)
    with pytest.raises(vi.InputError, match="events must be a dictionary"):
        vi.simulate(system, **START, duration=1.0, u=0.7, events=[foreign])


@pytest.mark.parametrize("asked", [{"duration": 1.0}, {"h": 0.1, "steps": 10}])
@pytest.mark.parametrize("verb", [vi.simulate, vi.ensemble])
def test_feedbacks_and_functions_of_time_are_led_into_the_scene(verb, asked):
    system = cart()
    feedback, drive = -system.q[1], ca.sin(vi.time())
    for u in (feedback, drive, [feedback], ca.vertcat(feedback, drive), lambda t: 1.0, np.cos):
        with pytest.raises(vi.InputError, match=r"u must be numbers.* belongs .*force="):
            verb(system, **START, **asked, u=u)
    with pytest.raises(vi.InputError, match="u is not finite everywhere"):
        verb(system, **START, **asked, u=np.inf)
    with pytest.raises(vi.InputError, match=r"u must be numbers.*, got str$"):
        verb(system, **START, **asked, u="push")


def test_what_is_no_such_control_is_told_of_as_before():
    system, asked = cart(), START | {"duration": 1.0}
    with pytest.raises(vi.InputError, match="u must be numbers"):
        vi.simulate(system, **asked, u="push")
    with pytest.raises(vi.InputError, match="u is not finite"):
        vi.simulate(system, **asked, u=[np.nan])
    with pytest.raises(vi.InputError, match=r"unknown parameters \['h'\]; known: \['g', 'control_"):
        vi.simulate(system, **asked, u=0.7, params={"h": 1.0})
    with pytest.raises(vi.InputError, match="was given, but the system has no control"):
        vi.simulate(vi.models.pendulum().system, q0=1.0, v0=0.0, duration=1.0, u=0.7)


def test_a_motion_that_ends_is_that_of_the_user():
    q, v = vi.coordinates("x")
    u = ca.SX.sym("u")
    system = vi.System(q, v, v**2 / 2 + q**4, control=u, force=u)
    with pytest.raises(vi.ConvergenceError) as told:
        vi.simulate(system, q0=1.0, v0=1.0, duration=9.0, u=0.5)
    reached = told.value.trajectory
    assert reached.system is system and (reached.u == 0.5).all() and len(reached) > 10


def test_scenes_with_ways_of_their_own_keep_to_them():
    q, v = vi.coordinates("x", "y")
    u = ca.SX.sym("u")
    circle = ca.sumsqr(q) - 1
    held = vi.System(q, v, ca.sumsqr(v) / 2, control=u, force=u * v, constraint=circle)
    follows = vi.System(q, v, ca.sumsqr(v) / 2 + 1 / ca.norm_2(q), control=u, force=u * v)
    dry = vi.System(q, v, ca.sumsqr(v) / 2, control=u, force=u - ca.sign(v))
    for scene in (held, follows, dry):
        assert steady_controls._controls_as_parameters(scene) is None
