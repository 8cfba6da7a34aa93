"""Runs whose steps are chosen are kept whole in checkpoint files, and come back with every byte."""

from __future__ import annotations

import subprocess
import sys
import warnings
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from saved_files import parts_of, put
from scenes import cartesian_pendulum, double_pendulum, rocking
from stopped_runs import Stopped

import varint as vi
from varint.integration import interpreted_loop, kept

FORMAT = "varint checkpoint of a motion 1"
X, Y = vi.coordinates("x"), vi.coordinates("x", "y")
U = ca.SX.sym("u")


def far_orbit(**more):
    """Ten revolutions with e = 0.99."""
    model = vi.models.kepler(e=0.99)
    return model.system, dict(q0=model.q0, v0=model.v0, duration=20 * np.pi) | more


def orbit(**more):
    system, start = far_orbit(duration=20.0)
    if "p0" in more:
        start.pop("v0")
    return system, start | more


def polar():
    """A rate of its own, in flight."""
    q, v = vi.coordinates("r", "a")
    system = vi.System(q, v, (v[0] ** 2 + q[0] ** 2 * v[1] ** 2) / 2 + 1 / q[0])
    return system, dict(q0=[0.1, 0.0], v0=[0.0, 43.6], duration=6.0)


def settling(**more):
    q, v = vi.coordinates("theta")
    system = vi.System(q, v, v**2 / 2 + 9.81 * ca.cos(q), force=-v)
    return system, dict(q0=1.0, v0=0.0, duration=60.0, tol=1e-6) | more


def chaotic():
    start = dict(q0=[2.0, 2.0], v0=[0.0, 0.0], duration=100.0)
    return double_pendulum(), start


def rubbing(**more):
    """Dry friction, and a wall."""
    q, v = X
    system = vi.System(q, v, v**2 / 2 - q**2 / 2, force=-0.1 * ca.sign(v), contact=q + 0.3)
    return system, dict(q0=1.0, v0=0.0, duration=10.0) | more


def pushed(**more):
    """By a table of controls."""
    q, v = X
    system = vi.System(q, v, v**2 / 2 + ca.cos(q), force=U, control=U)
    table = np.sin(np.arange(20.0))[:, None]
    return system, dict(q0=0.3, v0=0.0, duration=10.0, u=table) | more


def pushed_and_rubbing():
    """By controls that vary within the rows of their table."""
    q, v = X
    system = vi.System(q, v, v**2 / 2 - q**2 / 2, force=U - 0.1 * ca.sign(v), control=U)
    table = np.sin(np.arange(8.0)).reshape(4, 2, 1)
    return system, dict(rule=vi.gauss(2), q0=1.0, v0=0.0, duration=4.0, u=table)


def blocks(**more):
    start = dict(q0=[1.0, 0.5, 1.2], v0=[1.5, 0, 0], duration=1.5, tol=1e-5)
    return rocking(), start | more


def on_a_circle(**more):
    start = dict(q0=[0.6, -0.8], v0=[0.0, 0.0], duration=5.0)
    return cartesian_pendulum(), start | more


def held_twice():
    q, v = Y
    rows = ca.vertcat(ca.sumsqr(q) - 1, 2 * ca.sumsqr(q) - 2)
    system = vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[1], constraint=rows)
    return system, dict(q0=[0.6, -0.8], v0=[0.0, 0.0], duration=2.0)


HEIGHT = Y[0][1]
RUNS = {
    "that follows the scene": far_orbit(),
    "in flight": polar(),
    "that follows it, at times": orbit(at=np.linspace(0, 20, 7)),
    "that follows it, thinned": orbit(save_every=7),
    "that follows it, watched": orbit(events={"node": HEIGHT}, save_every=5),
    "that follows it, until": orbit(until=(HEIGHT, -1), events={"node": HEIGHT}),
    "that follows it, shown": orbit(events={"node": HEIGHT}, progress=True),
    "that follows it, by hand": orbit(duration=4.0, tol=1e-5, backend="interpreted"),
    "from momenta, backwards": orbit(p0=[0.0, 14.1], duration=-5.0, t0=3.0),
    "whose steps grow": settling(),
    "whose steps grow, at times": settling(at=np.linspace(0, 60, 9)),
    "that settles, watched": settling(events={"zero": X[0] * 0 + vi.coordinates("theta")[0]}),
    "out of reach": chaotic(),
    "by a given rule": (double_pendulum(), chaotic()[1] | dict(rule=vi.gauss(3), duration=2.0)),
    "with a scale": (double_pendulum(), chaotic()[1] | dict(scale=[1.0, 2.0], duration=2.0)),
    "divided": orbit(duration=1.0, tol=1e-5, on_failure="subdivide"),
    "by hand": settling(duration=3.0, tol=1e-4, backend="interpreted"),
    "with contacts": blocks(),
    "with contacts, at times": blocks(at=np.linspace(0, 1.5, 9)),
    "with contacts, thinned": blocks(save_every=4),
    "with switches": rubbing(),
    "with switches, watched": rubbing(events={"zero": X[0]}, save_every=5),
    "with controls": pushed(),
    "with controls, until": pushed(until=X[0] - 0.25),
    "with controls within rows": pushed_and_rubbing(),
    "on a manifold": on_a_circle(),
    "on a manifold, until": on_a_circle(until=Y[0][0]),
    "with redundant rows": held_twice(),
}
ARRAYS = ("t", "q", "p", "v", "k", "u", "c", "energy", "sizes", "active_set")


def simulate(system, asked, **more):
    """The motion, and what is said of it."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        motion = vi.simulate(system, **asked, **more)
    return motion, [str(one.message) for one in said]


def bytes_of(x):
    return x if x is None else (x.shape, x.dtype, x.tobytes())


def told(motion):
    """Stats without the clock, and without which of two loops with the same bytes it was."""
    known = {name: x for name, x in motion.stats.items() if name not in ("seconds", "backend")}
    return known | {"plan": str(known["plan"])}


def assert_equal(one, other):
    for name in ARRAYS:
        assert bytes_of(getattr(one, name)) == bytes_of(getattr(other, name)), name
    for name in ("system", "events", "active_sets", "h", "origin", "rule"):
        assert getattr(one, name) == getattr(other, name), name
    assert told(one) == told(other)
    times = np.linspace(one.t[0], one.t[-1], 23)
    there, same = one.at(times), other.at(times)
    for name in ("q", "v", "p", "energy"):
        assert bytes_of(getattr(there, name)) == bytes_of(getattr(same, name)), name
    if one.system.structure.constraints or one.system.structure.contacts:
        assert bytes_of(one.multipliers) == bytes_of(other.multipliers)
    assert (one.fictitious is None) == (other.fictitious is None)
    if one.fictitious is not None:
        assert other.fictitious.system is one.fictitious.system
        assert bytes_of(other.fictitious.q) == bytes_of(one.fictitious.q)
        assert one.action == other.action


def no_run(monkeypatch):
    """Nothing but the file is asked any more."""
    real = kept.kept_motion

    def never():
        raise AssertionError("a run is made")

    monkeypatch.setattr(kept, "kept_motion", lambda _, *asked: real(never, *asked))


@pytest.mark.parametrize("name", RUNS)
def test_a_run_comes_back_from_its_file_as_it_is_without_one(tmp_path, monkeypatch, name):
    system, asked = RUNS[name]
    path = tmp_path / "run"
    whole, said = simulate(system, asked)
    first, first_said = simulate(system, asked, checkpoint=path)
    assert parts_of(path)[0]["format"] == FORMAT
    no_run(monkeypatch)
    again, again_said = simulate(system, asked, checkpoint=path)
    assert said == first_said == again_said
    assert again.system is system
    assert_equal(whole, first)
    assert_equal(whole, again)


def test_what_is_kept_is_of_the_kinds_that_it_should_be():
    """Of the runs above: otherwise they would show nothing."""
    found = {name: simulate(*run) for name, run in RUNS.items()}
    motions = {name: motion for name, (motion, _) in found.items()}
    assert len(motions["that follows the scene"]) < 300
    follow = [name for name in RUNS if name.startswith("that follows")]
    assert not [x for x in (*follow, "in flight") if motions[x].fictitious is None]
    assert motions["whose steps grow"].sizes is not None
    assert "out of reach" in found["out of reach"][1][0]
    assert motions["with switches"].stats["switches"] > 1
    assert len(motions["with contacts"].active_sets) > 1
    assert len(motions["with redundant rows"].active_sets) == 1
    watched = ("that follows it, watched", "with switches, watched", "that settles, watched")
    assert all(motions[name].events for name in watched)


def test_a_motion_comes_back_in_another_process(tmp_path):
    code = (
        "import sys; sys.path[:0] = sys.argv[1:4]\n"
        "from test_checkpoint_of_chosen_steps import far_orbit, vi\nsystem, asked = far_orbit()\n"
        "vi.simulate(system, **asked, checkpoint=sys.argv[4])"
    )
    here, path = Path(__file__).resolve().parents[1], tmp_path / "run"
    folders = [str(x) for x in (here.parent, here, here / "integration")]
    subprocess.run([sys.executable, "-c", code, *folders, str(path)], check=True, timeout=60)
    system, asked = far_orbit()
    again = vi.simulate(system, **asked, checkpoint=path)
    assert_equal(vi.simulate(system, **asked), again)


OTHERS = {
    "tol": dict(tol=1e-8),
    "duration": dict(duration=61.0),
    "scale": dict(scale=2.0),
    "save_every": dict(save_every=2),
    "backend": dict(backend="native"),
    "on_failure": dict(on_failure="subdivide"),
    "given rule": dict(rule=vi.gauss(8)),
    "until": dict(until=vi.coordinates("theta")[0] - 9),
    "events": dict(events={"zero": vi.coordinates("theta")[0]}),
    "at": dict(at=[1.0, 60.0]),
    "q0": dict(q0=1.1),
    "v0": dict(v0=0.1),
    "t0": dict(t0=1.0),
    "params": dict(params={"g": 9.82}),
}


@pytest.mark.parametrize("name", OTHERS)
def test_what_shapes_the_bytes_tells_runs_apart(tmp_path, name):
    q, v = vi.coordinates("theta")
    c = vi.Parameters(g=9.81)
    system = vi.System(q, v, v**2 / 2 + c.g * ca.cos(q), force=-v, params=c)
    asked = settling(checkpoint=tmp_path / "run")[1]
    vi.simulate(system, **asked)
    with pytest.raises(vi.InputError, match=rf"another run: it differs in \[.*'{name}'"):
        vi.simulate(system, **asked | OTHERS[name])


def test_momenta_and_controls_tell_runs_apart_too(tmp_path):
    system, asked = pushed(checkpoint=tmp_path / "run")
    vi.simulate(system, **asked)
    other = asked["u"].copy()
    other[7] += 1e-15
    for more, name in ((dict(u=other), "u"), (dict(v0=None, p0=0.0), "v0")):
        with pytest.raises(vi.InputError, match=rf"it differs in \['{name}'\]"):
            vi.simulate(system, **asked | more)


@pytest.mark.parametrize("old", ["varint checkpoint 6", "varint checkpoint of switches 1"])
def test_files_of_before_are_refused_by_their_format(tmp_path, old):
    system, asked = settling(checkpoint=tmp_path / "run")
    vi.simulate(system, **asked)
    header, arrays = parts_of(tmp_path / "run")
    put(tmp_path / "run", header | {"format": old}, arrays)
    with pytest.raises(vi.InputError, match=f"'{old}', not '{FORMAT}'; move it away"):
        vi.simulate(system, **asked)


def test_runs_with_given_and_with_chosen_steps_do_not_take_each_others_files(tmp_path):
    system, asked = settling(checkpoint=tmp_path / "run")
    given = {name: x for name, x in asked.items() if name != "tol"} | dict(steps=600)
    vi.simulate(system, **given)
    with pytest.raises(vi.InputError, match="has the format 'varint checkpoint 6', not"):
        vi.simulate(system, **asked)
    (tmp_path / "run").unlink()
    vi.simulate(system, **asked)
    with pytest.raises(vi.InputError, match=f"has the format '{FORMAT}', not"):
        vi.simulate(system, **given)
    motion = vi.simulate(system, **given | dict(checkpoint=None))
    (tmp_path / "run").unlink()
    motion.save(tmp_path / "run.npz")
    with pytest.raises(vi.InputError, match="has the format 'varint trajectory 2', not"):
        vi.simulate(system, **asked | dict(checkpoint=tmp_path / "run.npz"))


def test_torn_and_misplaced_files_are_refused_before_any_run(tmp_path, monkeypatch):
    path = tmp_path / "run"
    system, asked = orbit(checkpoint=path, events={"node": HEIGHT})
    vi.simulate(system, **asked)
    whole = path.read_bytes()
    no_run(monkeypatch)
    for length in (0, 1, 100, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:length])
        with pytest.raises(vi.InputError, match=r"torn or no checkpoint.*move it away"):
            vi.simulate(system, **asked)
    path.write_bytes(whole)
    header, arrays = parts_of(path)
    for name in ("q", "k", "fictitious_p"):
        put(path, header, {x: y for x, y in arrays.items() if x != name})
        with pytest.raises(vi.InputError, match=r"not whole: .* are missing; move it away"):
            vi.simulate(system, **asked)
    put(path, header | {"fictitious": header["fictitious"] | {"time scale": "mine"}}, arrays)
    with pytest.raises(vi.InputError, match="not whole"):
        vi.simulate(system, **asked)
    with pytest.raises(vi.InputError, match="there is no folder"):
        vi.simulate(system, **asked | dict(checkpoint=tmp_path / "no" / "run"))


def interrupted(monkeypatch, error, when):
    """The next run ends with an error at such a part of all its calls of the interpreted loop."""
    real, calls = interpreted_loop.call, []

    def counted(*arguments):
        calls.append(1)
        if when is not None and len(calls) == when:
            raise error
        return real(*arguments)

    monkeypatch.setattr(interpreted_loop, "call", counted)
    return calls


@pytest.mark.parametrize("error", [KeyboardInterrupt, Stopped])
@pytest.mark.parametrize("share", [0.02, 0.3, 0.7])
@pytest.mark.parametrize("kind", [settling, orbit])
def test_a_choice_that_is_stopped_leaves_no_file(tmp_path, monkeypatch, error, share, kind):
    """No part of a run says what a whole one errs by: Ctrl-C ends the choice."""
    asked = kind(duration=5.0, tol=1e-4, backend="interpreted", save_every=3)
    path = tmp_path / "run"
    with monkeypatch.context() as patch:
        calls = interrupted(patch, error, None)
        whole, _ = simulate(*asked)
    with monkeypatch.context() as patch, pytest.raises(error):
        interrupted(patch, error, max(round(share * len(calls)), 1))
        simulate(*asked, checkpoint=path)
    assert not list(tmp_path.iterdir())
    assert_equal(whole, simulate(*asked, checkpoint=path)[0])


def test_a_watched_run_that_ctrl_c_ends_is_returned_and_not_kept(tmp_path, monkeypatch):
    theta = vi.coordinates("theta")[0]
    more = dict(backend="interpreted", events={"zero": theta})
    asked = settling(duration=20.0, tol=1e-4, **more)
    path = tmp_path / "run"
    with monkeypatch.context() as patch:
        calls = interrupted(patch, KeyboardInterrupt, None)
        whole, _ = simulate(*asked)
    with monkeypatch.context() as patch:
        again = interrupted(patch, KeyboardInterrupt, len(calls))
        part, _ = simulate(*asked, checkpoint=path)
    assert len(again) == len(calls), "no run is made after Ctrl-C"
    assert part.stats["interrupted"] and 0 < len(part) < len(whole)
    assert not list(tmp_path.iterdir())
    assert_equal(whole, simulate(*asked, checkpoint=path)[0])


def test_what_a_killed_call_left_beside_its_file_is_no_file(tmp_path):
    system, asked = settling(checkpoint=tmp_path / "run")
    (tmp_path / "run.123-456.part").write_bytes(b"killed while writing")
    first, again = (vi.simulate(system, **asked) for _ in range(2))
    assert_equal(first, again)
    assert [x.name for x in tmp_path.iterdir()] == ["run"]


def test_a_warning_tells_where_the_user_called(tmp_path):
    system, asked = chaotic()
    for _ in range(2):
        with pytest.warns(UserWarning, match="out of reach") as said:
            vi.simulate(system, **asked, checkpoint=tmp_path / "run")
        assert [one.filename for one in said] == [__file__]


def test_a_file_that_another_run_wrote_meanwhile_stays(tmp_path, monkeypatch):
    path = tmp_path / "run"
    system, asked = settling(checkpoint=path)
    real = kept.kept_motion

    def late(make, *asked):
        def made():
            path.write_bytes(b"of another run")
            return make()

        return real(made, *asked)

    monkeypatch.setattr(kept, "kept_motion", late)
    with pytest.warns(UserWarning, match="not kept in its checkpoint: .* written meanwhile"):
        motion = vi.simulate(system, **asked)
    assert motion.stats["error_estimate"] <= 1e-6
    assert path.read_bytes() == b"of another run"
