"""Runs in fictitious time by one call of the core: the same numbers as the watched way, in both
gears.
"""

import pickle

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.integration.time_transformation import inner_run, physical_call, transformed_run

MODELS = {
    "kepler": (vi.models.kepler(e=0.9), 20.0),
    "arenstorf": (vi.models.arenstorf(), 17.0),
    "pythagorean": (vi.models.pythagorean_three_body(), 6.0),
    "pendulum": (vi.models.pendulum(), 5.0),  # the fewest coordinates
}


def start_of(name: str) -> dict:
    model, duration = MODELS[name]
    return dict(
        q0=model.q0, v0=model.v0, duration=duration, time_scale="auto", h=0.6, rule=vi.gauss(6)
    )


def watched(monkeypatch, system, **how):
    """The same run without the call of the core."""
    with monkeypatch.context() as patch:
        patch.setattr(physical_call, "physical_call", lambda *ignored: None)
        return vi.simulate(system, **how)


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("more", [{}, {"iteration_tol": 1e-6}, {"save_every": 7}, {"t0": 3.0}])
def test_nodes_are_those_of_the_watched_way(name, more, monkeypatch):
    system = MODELS[name][0].system
    how = start_of(name) | more
    found = vi.simulate(system, **how)
    other = watched(monkeypatch, system, **how)
    assert np.array_equal(found.k, other.k)
    for x in ("t", "q", "p"):
        assert np.array_equal(getattr(found, x)[:-1], getattr(other, x)[:-1])
    assert found.t[-1] == pytest.approx(other.t[-1], rel=1e-14)
    assert found.q[-1] == pytest.approx(other.q[-1], rel=1e-9, abs=1e-12)
    assert np.array_equal(found.c, other.c)
    assert np.array_equal(found.fictitious.c, other.fictitious.c)
    assert found.rule == other.rule and found.h == other.h
    times = np.linspace(found.t[0], found.t[-1], 9)
    assert found.at(times).q == pytest.approx(other.at(times).q, rel=1e-9, abs=1e-10)
    assert found.energy == pytest.approx(found.energy[0], rel=1e-5)


@pytest.mark.parametrize("name", MODELS)  # of 2, 3 and 7 coordinates with the clock
def test_both_gears_give_the_same_bytes(name):
    system, how = MODELS[name][0].system, start_of(name)
    one, other = (vi.simulate(system, backend=backend, **how) for backend in ("native", "compiled"))
    assert one.q.tobytes() == other.q.tobytes() and one.t.tobytes() == other.t.tobytes()
    assert one.p.tobytes() == other.p.tobytes()


def test_a_run_is_one_call_of_the_core(monkeypatch):
    calls = []
    real = inner_run.run_until

    def counted(*arguments, **how):
        calls.append(real(*arguments, **how))
        return calls[-1]

    monkeypatch.setattr(inner_run, "run_until", counted)
    monkeypatch.setattr(transformed_run, "prepare", lambda *ignored: pytest.fail("prepared"))
    motion = vi.simulate(MODELS["kepler"][0].system, **start_of("kepler"))
    assert len(calls) == 1 and calls[0].nodes == len(motion)


def test_it_leads_back():
    model, duration = MODELS["pythagorean"]
    how = dict(time_scale="auto", h=0.5, rule=vi.gauss(6))
    there = vi.simulate(model.system, q0=model.q0, v0=model.v0, duration=duration, **how)
    how["h"] = -0.5
    back = vi.simulate(model.system, q0=there.q[-1], v0=there.v[-1], duration=-duration, **how)
    assert back.t[-1] == pytest.approx(-duration, rel=1e-14)
    assert back.q[-1] == pytest.approx(np.array(model.q0), abs=1e-8)


def test_the_end_may_be_a_node():
    system = MODELS["kepler"][0].system
    how = start_of("kepler") | {"time_scale": vi.close_encounters(ca.norm_2(system.q))}
    node = vi.simulate(system, **how).t[12]
    found = vi.simulate(system, **(how | {"duration": node}))
    assert found.t[-1] == pytest.approx(node, rel=1e-14) and len(found) == 13


@pytest.mark.parametrize("backend", ["native", "compiled"])
@pytest.mark.parametrize("steps", [3, 20, 30])
def test_a_run_takes_no_step_behind_its_end(steps, backend):
    model = vi.models.kepler(e=0.6)
    scale = vi.close_encounters(ca.norm_2(model.system.q))
    how = dict(q0=model.q0, v0=model.v0, h=0.6, rule=vi.gauss(6), time_scale=scale, backend=backend)
    whole = vi.simulate(model.system, steps=steps, **how)
    found = vi.simulate(model.system, duration=whole.t[-2:].mean(), **how)
    assert len(found) == len(whole)
    assert found.stats["iterations"] == whole.stats["iterations"]


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("iteration_tol", [None, 1e-9, 1e-6, 1e-2])
@pytest.mark.parametrize("rule", [vi.gauss(3), vi.gauss(8)])
def test_the_clock_shows_the_duration_to_the_last_digit(rule, iteration_tol, sign):
    model = vi.models.kepler(e=0.6)
    how = dict(q0=model.q0, v0=model.v0, h=0.1 * sign, rule=rule, iteration_tol=iteration_tol)
    found = vi.simulate(model.system, duration=sign * 7.3, time_scale="auto", **how)
    assert found.t[-1] == sign * 7.3


def test_more_nodes_than_there_is_room_for(monkeypatch):
    monkeypatch.setattr("varint.codegen.until.ROOM", 300)
    monkeypatch.setattr("varint.codegen.until._rooms", [])
    found = vi.simulate(MODELS["kepler"][0].system, **start_of("kepler"))
    monkeypatch.undo()
    again = vi.simulate(MODELS["kepler"][0].system, **start_of("kepler"))
    assert len(found) == len(again) > 300 // 9
    assert np.array_equal(found.q[:-1], again.q[:-1])


def test_a_run_leaves_those_before_it_alone():
    system, how = MODELS["kepler"][0].system, start_of("kepler")
    first = vi.simulate(system, **how)
    inner = first.fictitious
    arrays = first.t, first.q, first.p, first.k, first.c, inner.t, inner.q, inner.p, inner.c
    before = [x.copy() for x in arrays]
    vi.simulate(system, **(how | {"v0": 1.01 * np.array(how["v0"])}))
    assert all(np.array_equal(*pair) for pair in zip(before, arrays, strict=True))


def test_of_nodes_further_apart_than_the_run_is_long_the_ends_are_kept():
    system, how = MODELS["kepler"][0].system, start_of("kepler")
    whole, ends = (vi.simulate(system, save_every=every, **how) for every in (1, 10**30))
    for x in ("t", "q", "p", "k"):
        assert np.array_equal(getattr(ends, x), getattr(whole, x)[[0, -1]])


def bytes_of(motion) -> tuple[bytes, ...]:
    arrays = (getattr(x, name) for x in (motion, motion.fictitious) for name in "tqpkc")
    return tuple(x.tobytes() for x in arrays)


@pytest.mark.parametrize("rule", [vi.gauss(6), vi.gauss(8)])
def test_what_was_run_before_makes_no_difference(rule):
    """A start that is there already is not written anew; another start, duration or parameter is,
    also where it differs in a sign that numbers do not show, and after a start that was refused.
    """
    model = vi.models.kepler(e=0.9)
    name = next(iter(model.system.defaults))
    how = dict(h=0.6, time_scale="auto", rule=rule, q0=model.q0, v0=model.v0, duration=7.0)
    v0 = np.array(model.v0)
    calls = [
        how,
        how | {"v0": 1.01 * v0},
        how | {"duration": 3.0},
        how | {"h": -0.6, "duration": -7.0},
        how | {"params": {name: 1.5}},
        how,
        how | {"q0": [model.q0[0], -0.0]},
        how | {"params": {name: 1.5}, "v0": 1.01 * v0},
        how | {"t0": 2.0},
        how | {"iteration_tol": 1e-6},
    ]
    fresh = [bytes_of(vi.simulate(vi.models.kepler(e=0.9).system, **each)) for each in calls]
    again = [vi.simulate(model.system, **each) for each in (*calls, *calls)]
    with pytest.raises(vi.InputError, match="v0"):
        vi.simulate(model.system, **(how | {"v0": [np.nan, 1.0]}))
    again += [vi.simulate(model.system, **each) for each in calls]
    assert [bytes_of(x) for x in again] == 3 * fresh


def test_the_motion_in_fictitious_time_is_made_when_it_is_asked_for(monkeypatch):
    system, how = MODELS["kepler"][0].system, start_of("kepler")
    motion, part, copied = (vi.simulate(system, **how) for _ in range(3))
    assert "fictitious" not in vars(motion)
    assert motion.fictitious is motion.fictitious
    other = watched(monkeypatch, system, **how)
    assert np.array_equal(motion.fictitious.q[:-1], other.fictitious.q[:-1])
    assert np.array_equal(part[3:7].fictitious.t, motion.fictitious.t[3:7])
    there = pickle.loads(pickle.dumps(copied))
    assert np.array_equal(there.fictitious.p, motion.fictitious.p)
    assert vi.Trajectory.fictitious is None
    plain = vi.simulate(system, vi.gauss(6), q0=how["q0"], v0=how["v0"], h=0.01, steps=3)
    assert plain.fictitious is None


def test_nodes_have_memory_of_their_own():
    system, how = MODELS["kepler"][0].system, start_of("kepler")
    motion, other = vi.simulate(system, **how), vi.simulate(system, **how)
    before = bytes_of(other)
    motion.q[0] = 7.0
    assert bytes_of(other) == bytes_of(vi.simulate(system, **how)) == before


def test_what_was_asked_last_is_not_taken_for_another():
    system, how = MODELS["kepler"][0].system, start_of("kepler")
    asked = [
        how,
        how | {"rule": vi.gauss(4)},
        how | {"h": 0.3},
        how | {"h": 3, "duration": 20},
        how | {"duration": 10.0},
        how | {"save_every": 7},
        how | {"iteration_tol": 1e-6},
        how | {"time_scale": ca.sumsqr(system.q)},
    ]
    fresh = [bytes_of(vi.simulate(vi.models.kepler(e=0.9).system, **each)) for each in asked[:-1]]
    fresh.append(bytes_of(vi.simulate(system, **asked[-1])))
    order = np.random.default_rng(3).integers(0, len(asked), 60).tolist()
    assert all(bytes_of(vi.simulate(system, **asked[i])) == fresh[i] for i in order)
    for wrong in ({"h": -0.6}, {"h": np.inf}, {"h": 1e-200}, {"t0": 1e300}, {"duration": np.nan}):
        for _ in range(2):
            with pytest.raises(vi.InputError):
                vi.simulate(system, **(how | wrong))


def test_a_time_scale_whose_entry_has_changed_is_another_one():
    system, how = MODELS["kepler"][0].system, start_of("kepler")
    square = ca.sumsqr(system.q)
    scale, root = ca.SX(square), ca.sqrt(square)
    before = vi.simulate(system, **(how | {"time_scale": scale}))
    scale[0] = root
    after = vi.simulate(system, **(how | {"time_scale": scale}))
    assert bytes_of(after) == bytes_of(vi.simulate(system, **(how | {"time_scale": root})))
    assert len(after) != len(before)


@pytest.mark.parametrize(
    "other",
    [
        {"h": True},
        {"h": np.float64(1)},
        {"h": np.int64(1)},
        {"h": np.array([1.0, 2.0])},
        {"t0": False},
        {"t0": None},
        {"iteration_tol": np.float64(1e-6)},
        {"iteration_tol": np.array([1e-6, 1e-6])},
        {"iteration_tol": True},
        {"save_every": True},
        {"steps": np.array([3, 4])},
        {"backend": None},
        {"tol": 1e-6},
    ],
    ids=str,
)
def test_what_equals_a_good_run_but_is_of_another_kind_is_treated_as_without_it(other):
    """Where a run was good, the next one is only compared with it."""
    good = start_of("kepler") | {"h": 1.0, "iteration_tol": 1e-6}

    def told(system) -> object:
        try:
            return bytes_of(vi.simulate(system, **(good | other)))
        except vi.InputError as refused:
            return str(refused)

    system = vi.models.kepler(e=0.9).system
    vi.simulate(system, **good)
    assert told(system) == told(vi.models.kepler(e=0.9).system)
