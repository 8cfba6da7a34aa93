"""A checkpoint is taken by its own run alone: torn, foreign and old ones are refused."""

from __future__ import annotations

import casadi as ca
import pytest
from saved_files import parts_of, put
from scenes import double_pendulum, pendulum

import varint as vi


def test_torn_foreign_and_misplaced_checkpoints_are_refused(tmp_path):
    path, start = tmp_path / "run", dict(q0=1.0, v0=0.0, h=0.01, steps=2000)
    vi.simulate(pendulum(), checkpoint=path, **start)
    whole = path.read_bytes()
    for length in (0, 1, 100, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:length])
        with pytest.raises(vi.InputError, match="torn or no checkpoint"):
            vi.simulate(pendulum(), checkpoint=path, **start)
    for i in range(200, len(whole) - 2000, len(whole) // 7):
        path.write_bytes(whole[:i] + bytes([whole[i] ^ 1]) + whole[i + 1 :])
        with pytest.raises(vi.InputError, match="torn or no checkpoint"):
            vi.simulate(pendulum(), checkpoint=path, **start)
    path.write_bytes(whole)
    others = [
        (dict(q0=1.1), "q0"),
        (dict(h=0.02), "h"),
        (dict(steps=2001), "steps"),
        (dict(save_every=2), "save_every"),
    ]
    for other, name in others:
        with pytest.raises(vi.InputError, match=rf"another run: it differs in .*'{name}'"):
            vi.simulate(pendulum(), checkpoint=path, **{**start, **other})
    with pytest.raises(vi.InputError, match=r"another run: it differs in .*system"):
        vi.simulate(double_pendulum(), checkpoint=path, q0=[1, 0], v0=[0, 0], h=0.01, steps=2000)
    with pytest.raises(vi.InputError, match="there is no folder"):
        vi.simulate(pendulum(), checkpoint=tmp_path / "no" / "run", **start)


def watched(**wanted) -> dict:
    """A run that is watched by expressions of the coordinates; symbols are new in every call."""
    system = double_pendulum()
    made = {name: make(system) for name, make in wanted.items()}
    return dict(system=system, rule=vi.gauss(2), q0=[0.4, 0.2], v0=[0, 0], h=0.01) | made


def level(height: float, direction: int | None = None):
    """Where a coordinate passes a height."""

    def expression(system):
        e = system.q[0] - height
        return e if direction is None else (e, direction)

    return expression


def named(**events):
    return lambda system: {name: make(system) for name, make in events.items()}


OTHERS = [
    (dict(events=named(a=level(0.1))), dict(events=named(a=level(0.1 + 1e-9))), "events"),
    (dict(events=named(a=level(0.1))), dict(events=named(b=level(0.1))), "events"),
    (dict(events=named(a=level(0.1))), dict(events=named(a=level(0.1, 1))), "events"),
    (dict(events=named(a=level(0.1, -1))), dict(events=named(a=level(0.1, 1))), "events"),
    (dict(events=named(a=level(0.1))), dict(), "events"),
    (dict(events=named(until=level(0.1))), dict(until=level(0.1)), "until"),
    (dict(until=level(-9.1)), dict(until=level(-9.1 - 1e-12)), "until"),
    (dict(until=level(-9.1)), dict(until=level(-9.1, -1)), "until"),
    (
        dict(events=named(a=lambda s: ca.sin(s.q[0] / 1000003) - 1e-7)),
        dict(events=named(a=lambda s: ca.sin(s.q[0] / 1000004) - 1e-7)),
        "events",
    ),
    (dict(events=named(a=level(0.1))), dict(events=named(a=lambda s: s.q[1] - 0.1)), "events"),
    (
        dict(events=named(a=level(0.1), b=level(0.2))),
        dict(events=named(b=level(0.1), a=level(0.2))),
        "events",
    ),
]


@pytest.mark.parametrize(("mine", "other", "name"), OTHERS)
def test_runs_with_other_events_do_not_share_a_checkpoint(tmp_path, mine, other, name):
    """Printed, these expressions differ in their seventh digit or not at all."""
    path = tmp_path / "run"
    first = vi.simulate(**watched(**mine), steps=300, checkpoint=path)
    with pytest.raises(vi.InputError, match=rf"another run: it differs in .*'{name}'"):
        vi.simulate(**watched(**other), steps=300, checkpoint=path)
    again = vi.simulate(**watched(**mine), steps=300, checkpoint=path)
    assert again.events == first.events and again.q.tobytes() == first.q.tobytes()


def test_scenes_and_parameters_that_print_alike_do_not_share_a_checkpoint(tmp_path):
    def run(stiffness: float, **params):
        q, v = vi.coordinates("x")
        c = vi.Parameters(a=1.0)
        system = vi.System(q, v, v**2 / 2 - stiffness * q**2 - c.a * q**4, params=c)
        start = dict(q0=1.0, v0=0.0, h=0.01, steps=2000, params=params)
        return vi.simulate(system, checkpoint=tmp_path / "run", **start)

    first = run(1 / 3)
    with pytest.raises(vi.InputError, match=r"another run: it differs in .*system"):
        run(0.333333)
    with pytest.raises(vi.InputError, match=r"another run: it differs in .*system"):
        run(1 / 3 + 6e-17)
    with pytest.raises(vi.InputError, match=r"another run: it differs in \['params'\]"):
        run(1 / 3, a=1 + 1e-15)
    assert run(1 / 3).q.tobytes() == first.q.tobytes()


@pytest.mark.parametrize("other", [dict(iteration_tol=1e-6), dict(on_failure="subdivide")])
def test_what_else_shapes_the_bytes_tells_runs_apart(tmp_path, other):
    start = dict(q0=[0.4, 0.2], v0=[0, 0], h=0.01, steps=2000, checkpoint=tmp_path / "run")
    vi.simulate(double_pendulum(), vi.gauss(2), **start)
    with pytest.raises(vi.InputError, match="another run"):
        vi.simulate(double_pendulum(), vi.gauss(2), **start | other)


def test_a_run_that_finds_no_compiler_next_time_is_not_mixed_up(tmp_path, monkeypatch):
    """By default the loop is chosen; interpreted, a run has other last digits."""
    from varint.integration import run as runs

    start = dict(q0=[0.4, 0.2], v0=[0, 0], h=0.01, steps=2000, checkpoint=tmp_path / "run")
    choose = runs.kernel_for

    def compiled(system, rule, problem, backend):
        return choose(system, rule, problem, "compiled")

    with monkeypatch.context() as patch:
        patch.setattr(runs, "kernel_for", compiled)
        vi.simulate(double_pendulum(), vi.gauss(2), **start)
    monkeypatch.setattr(runs, "kernel_for", lambda *arguments: None)
    with pytest.raises(vi.InputError, match=r"another run: it differs in \['loop'\]"):
        vi.simulate(double_pendulum(), vi.gauss(2), **start)


@pytest.mark.parametrize("old", [f"varint checkpoint {number}" for number in (3, 4, 5)])
def test_checkpoints_of_before_are_refused_by_their_format(tmp_path, old):
    start = dict(q0=1.0, v0=0.0, h=0.01, steps=2000, checkpoint=tmp_path / "run")
    vi.simulate(pendulum(), **start)
    header, arrays = parts_of(tmp_path / "run")
    put(tmp_path / "run", header | {"format": old}, arrays)
    with pytest.raises(vi.InputError, match=f"'{old}', not 'varint checkpoint 6'; move it away"):
        vi.simulate(pendulum(), **start)
