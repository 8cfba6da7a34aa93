"""Runs that are killed, interrupted, torn or foreign: nothing is lost, nothing is mixed up."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from scenes import double_pendulum, pendulum, rocking

import varint as vi
from varint.integration import checkpoint as module
from varint.integration.interpreted_loop import next_block

ARRAYS = ("t", "q", "p", "k")

KILLED = r"""
import json, os, random, signal, sys, time
sys.path[:0] = sys.argv[1:3]
import numpy as np
import varint as vi
from scenes import double_pendulum, rocking
from varint.integration import checkpoint, compiled_loop

checkpoint.PAUSE, checkpoint.MOST_SHARE = 0.0, 1e9  # after every block
compiled_loop.STEPS_IN_BLOCK = 2000
folder, seed, kind = sys.argv[3], int(sys.argv[4]), sys.argv[5]
scene, moments = rocking() if kind == "contacts" else double_pendulum(), random.Random(seed)
rule = None if kind == "contacts" else vi.gauss(2)
if kind == "contacts":
    start = dict(q0=[1.0, 0.5, 1.2], v0=[1.5, 0, 0], h=0.01, steps=20_000, save_every=3)
elif kind == "compiled":
    start = dict(q0=[1.5, 1.5], v0=[0, 0], h=0.01, steps=1_000_000, save_every=300, backend=kind)
else:
    start = dict(q0=[np.pi / 2] * 2, v0=[0, 0], h=0.01, steps=30_000, save_every=3, backend=kind)


def run(path):
    return vi.simulate(scene, rule, checkpoint=path, **start)


rule and vi.simulate(scene, rule, **start | dict(steps=3))  # compiles
began = time.perf_counter()
vi.simulate(scene, rule, **start).save(os.path.join(folder, "whole"))
length = time.perf_counter() - began
path, kills, resumed = os.path.join(folder, "run.checkpoint"), 0, set()
while kills < 20:
    child = os.fork()
    if not child:
        run(path)
        os._exit(0)
    time.sleep(moments.uniform(0.0, 0.3) * length)
    os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    kills += 1
    if os.path.exists(path):
        with np.load(path) as data:
            resumed.add(json.loads(str(data["header"]))["k"])
        if json.loads(str(np.load(path)["header"]))["k"] == start["steps"]:
            os.rename(path, os.path.join(folder, f"done{kills}"))
motion = run(path)
motion.save(os.path.join(folder, "killed"))
print(json.dumps(sorted(resumed)))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="needs fork and SIGKILL")
@pytest.mark.parametrize("kind", ["interpreted", "compiled", "contacts"])
def test_a_run_killed_at_20_random_moments_ends_with_the_bytes_of_one_that_was_not(tmp_path, kind):
    here = Path(__file__).resolve().parents[1]
    script = tmp_path / "killed.py"
    script.write_text(KILLED)
    call = [sys.executable, str(script), str(here.parent), str(here), str(tmp_path), "20", kind]
    done = subprocess.run(call, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert len(found) >= 5, f"the kills left only these checkpoints: {found}"
    whole, killed = vi.load(tmp_path / "whole.npz"), vi.load(tmp_path / "killed.npz")
    for name in ARRAYS:
        assert getattr(whole, name).tobytes() == getattr(killed, name).tobytes(), name


def stopped_after(monkeypatch, blocks: int, error: type[BaseException]) -> None:
    """The next run ends with an error as its `blocks`-th checkpoint has been written."""
    monkeypatch.setattr(module, "PAUSE", 0.0)
    monkeypatch.setattr(module, "MOST_SHARE", 1e9)
    write, left = module.Checkpoint.write, [blocks]

    def counted(self, *arguments):
        write(self, *arguments)
        left[0] -= 1
        if not left[0]:
            raise error

    monkeypatch.setattr(module.Checkpoint, "write", counted)


class Stopped(Exception):
    """What ends a run as a kill would, and nothing else."""


PUSH = ca.SX.sym("push")


def pushed() -> vi.System:
    q, v = vi.coordinates("x")
    return vi.System(q, v, v**2 / 2 - q**4 / 4, force=PUSH, control=PUSH)


@pytest.mark.parametrize("backend", ["interpreted", "compiled"])
@pytest.mark.parametrize("every", [1, 7])
@pytest.mark.parametrize("rule", [vi.composition("blanes-moan4"), vi.gauss(3)], ids=str)
def test_a_run_goes_on_from_its_checkpoint_with_controls_and_any_loop(
    tmp_path, monkeypatch, rule, every, backend
):
    from varint.integration import compiled_loop

    monkeypatch.setattr(compiled_loop, "NODES_IN_BLOCK", 300)
    u = np.sin(np.arange(5000) / 9)[:, None]
    start = dict(q0=1.0, v0=0.2, h=0.05, steps=5000, u=u, save_every=every, backend=backend)
    system, path = pushed(), tmp_path / "run"
    whole = vi.simulate(system, rule, **start)
    with monkeypatch.context() as patch:
        stopped_after(patch, 2, Stopped)
        with pytest.raises(Stopped):
            vi.simulate(system, rule, checkpoint=path, **start)
    assert 0 < module.Checkpoint(path, header_of(path)["identity"]).read()[-1].after.k < 5000
    again = vi.simulate(system, rule, checkpoint=path, **start)
    for name in ARRAYS:
        assert getattr(whole, name).tobytes() == getattr(again, name).tobytes(), name


@pytest.mark.parametrize("every", [1, 30_000])
def test_a_run_that_newtons_method_took_over_goes_on_from_its_checkpoint(
    tmp_path, monkeypatch, every
):
    """A spring that stiffens: fixed-point iteration gives up on the way."""
    from varint.integration import compiled_loop

    q, v = vi.coordinates("x", "y")
    t = vi.time()
    stiff = vi.System(
        q, v, ca.sumsqr(v) / 2 - (1 + t**2) * ca.cosh(q[0] - q[1]) - ca.sumsqr(q), t=t
    )
    start = dict(q0=[0.5, 0], v0=[0, 0], h=0.01, steps=60_000, save_every=every, backend="compiled")
    monkeypatch.setattr(compiled_loop, "STEPS_IN_BLOCK", 2500)
    whole = vi.simulate(stiff, vi.gauss(2), **start)
    with monkeypatch.context() as patch:
        stopped_after(patch, 15, Stopped)
        with pytest.raises(Stopped):
            vi.simulate(stiff, vi.gauss(2), checkpoint=tmp_path / "run", **start)
    with np.load(tmp_path / "run") as data:
        assert "carry" in data
    assert header_of(tmp_path / "run")["by_newton"] and header_of(tmp_path / "run")["k"] < 60_000
    again = vi.simulate(stiff, vi.gauss(2), checkpoint=tmp_path / "run", **start)
    for name in ARRAYS:
        assert getattr(whole, name).tobytes() == getattr(again, name).tobytes(), name


@pytest.mark.parametrize("blocks", [1, 2, 4])
@pytest.mark.parametrize("step", [0.06, 0.1])
def test_a_run_that_newtons_method_has_taken_over_goes_on_by_it(
    tmp_path, monkeypatch, step, blocks
):
    """h ω = 3: fixed-point iteration contracts poorly; h ω = 5: it fails."""
    from varint.integration import compiled_loop

    monkeypatch.setattr(compiled_loop, "NODES_IN_BLOCK", 500)
    model, path = vi.models.fpu_chain(omega=50.0), tmp_path / "run"
    start = dict(q0=model.q0, v0=model.v0, h=step, steps=4000, backend="compiled")
    whole = vi.simulate(model.system, vi.gauss(4), **start)
    with monkeypatch.context() as patch:
        stopped_after(patch, blocks, Stopped)
        with pytest.raises(Stopped):
            vi.simulate(model.system, vi.gauss(4), checkpoint=path, **start)
    again = vi.simulate(model.system, vi.gauss(4), checkpoint=path, **start)
    for name in ARRAYS:
        assert getattr(whole, name).tobytes() == getattr(again, name).tobytes(), name


@pytest.mark.parametrize("every", [1, 7, 100_000])
@pytest.mark.parametrize("rule", [vi.composition("verlet"), vi.gauss(1), vi.gauss(4)], ids=str)
def test_how_long_the_blocks_of_a_compiled_run_are_shows_in_nothing(monkeypatch, rule, every):
    """Ctrl-C waits for a block, so blocks are cut by the clock."""
    from varint.integration import compiled_loop

    start = dict(
        q0=[0.7, 0.2], v0=[0, 0], h=0.02, steps=120_001, save_every=every, backend="compiled"
    )
    q, v = vi.coordinates("x", "y")
    system = vi.System(q, v, ca.sumsqr(v) / 2 - ca.sumsqr(q) ** 2 + ca.cos(q[0] - q[1]))
    whole = vi.simulate(system, rule, **start)
    for most, patience in ((10**9, 1e-3), (997, 0.2), (10**9, 100.0)):
        monkeypatch.setattr(compiled_loop, "STEPS_IN_BLOCK", most)
        monkeypatch.setattr(compiled_loop, "PATIENCE", patience)
        again = vi.simulate(system, rule, **start)
        for name in ARRAYS:
            assert getattr(whole, name).tobytes() == getattr(again, name).tobytes(), name


def header_of(path: Path) -> dict:
    with np.load(path) as data:
        return json.loads(str(data["header"]))


def test_events_and_divided_steps_of_before_are_kept(tmp_path, monkeypatch):
    q, v = vi.coordinates("x", "y")
    kepler = vi.System(q, v, ca.sumsqr(v) / 2 + 1 / ca.norm_2(q))
    start = dict(
        q0=[1, 0],
        v0=[0, 0.1],
        h=0.02,
        steps=2000,
        on_failure="subdivide",
        events=dict(turn=ca.dot(q, v)),
    )
    with pytest.warns(UserWarning, match="h = 0.02 is too large"):
        whole = vi.simulate(kepler, vi.gauss(4), **start)
    assert any(event.kind.startswith("divided") for event in whole.events)
    with monkeypatch.context() as patch:
        stopped_after(patch, 3, Stopped)
        with pytest.raises(Stopped):
            vi.simulate(kepler, vi.gauss(4), checkpoint=tmp_path / "run", **start)
    with pytest.warns(UserWarning, match="h = 0.02 is too large"):
        again = vi.simulate(kepler, vi.gauss(4), checkpoint=tmp_path / "run", **start)
    assert again.events == whole.events
    for name in ARRAYS:
        assert getattr(whole, name).tobytes() == getattr(again, name).tobytes(), name


def test_a_run_that_is_done_comes_back_at_once(tmp_path, monkeypatch):
    start = dict(q0=1.0, v0=0.0, h=0.01, steps=2000, checkpoint=tmp_path / "run")
    first = vi.simulate(pendulum(), **start)

    def never(*arguments):
        raise AssertionError("the run was stepped again")

    monkeypatch.setattr("varint.integration.interpreted_loop.call", never)
    again = vi.simulate(pendulum(), **start)
    assert again.q.tobytes() == first.q.tobytes()


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


def test_ctrl_c_returns_what_there_is_and_the_checkpoint_goes_on_from_there(tmp_path, monkeypatch):
    start = dict(q0=[0.4, 0.2], v0=[0, 0], h=0.01, steps=20_000, backend="interpreted")
    whole = vi.simulate(double_pendulum(), vi.gauss(2), **start)
    with monkeypatch.context() as patch:
        stopped_after(patch, 3, KeyboardInterrupt)
        partial = vi.simulate(double_pendulum(), vi.gauss(2), checkpoint=tmp_path / "run", **start)
    assert partial.stats["interrupted"] and not whole.stats["interrupted"]
    assert 1000 <= len(partial) < 20_000
    np.testing.assert_array_equal(partial.q, whole.q[: len(partial)])
    again = vi.simulate(double_pendulum(), vi.gauss(2), checkpoint=tmp_path / "run", **start)
    assert again.p.tobytes() == whole.p.tobytes()


@pytest.mark.skipif(sys.platform == "win32", reason="needs SIGINT")
@pytest.mark.parametrize(
    ("backend", "every"), [("interpreted", 10), ("compiled", 10**4), ("compiled", 10**11)]
)
def test_a_real_interrupt_ends_a_run_with_its_nodes(backend, every):
    """Also within an interval between two nodes that would take a quarter of an hour."""
    code = (
        "import os, signal, threading, sys; sys.path[:0] = sys.argv[1:3]\nimport varint as vi; "
        "from scenes import double_pendulum, henon_heiles\nbackend, every = sys.argv[3], "
        "int(sys.argv[4])\nscene, rule = (henon_heiles(), None) if backend == 'compiled' else "
        "(double_pendulum(), vi.gauss(2))\nstart = dict(q0=[.4, .2], v0=[0, 0], h=0.01, "
        "save_every=every, backend=backend)\nvi.simulate(scene, rule, steps=10, **start | "
        "dict(save_every=1))\nthreading.Timer(1.0, lambda: os.kill(os.getpid(), "
        "signal.SIGINT)).start()\nm = vi.simulate(scene, rule, steps=max(10**8, every), "
        "**start)\nprint(m.stats['interrupted'], len(m) > 1 or every == 10**11, "
        "bool(abs(m.q).max() < 10))\n"
    )
    here = Path(__file__).resolve().parents[1]
    call = [sys.executable, "-c", code, str(here.parent), str(here), backend, str(every)]
    done = subprocess.run(call, capture_output=True, text=True, timeout=60)
    assert done.stdout.split() == ["True", "True", "True"], done.stderr


@pytest.mark.parametrize("every", [1, 7, 1000, 250_000])
@pytest.mark.parametrize("most", [10_000, 100])
def test_the_blocks_cover_every_step_once_and_depend_on_the_position_alone(every, most):
    steps, k, nodes = 123_456, 0, 0
    while k < steps:
        count, apart = next_block(k, steps, every, 1000, most)
        assert count * apart <= most
        k += count * apart
        nodes += k % every == 0 or k == steps
        assert count == 1 or apart == every
    assert k == steps


@pytest.mark.parametrize("every", [1, 7])
@pytest.mark.parametrize("blocks", [3, 10, 30])
def test_a_run_with_contacts_goes_on_from_its_checkpoint(tmp_path, monkeypatch, every, blocks):
    start = dict(q0=[1.0, 0.5, 1.2], v0=[1.5, 0, 0], h=0.01, steps=600, save_every=every)
    whole = vi.simulate(rocking(), **start)
    assert len(whole.events) > 5 and len(whole.active_sets) > 1
    with monkeypatch.context() as patch:
        stopped_after(patch, blocks, Stopped)
        with pytest.raises(Stopped):
            vi.simulate(rocking(), checkpoint=tmp_path / "run", **start)
    assert 0 <= header_of(tmp_path / "run")["k"] < 600
    again = vi.simulate(rocking(), checkpoint=tmp_path / "run", **start)
    for name in (*ARRAYS, "v", "multipliers"):
        assert getattr(whole, name).tobytes() == getattr(again, name).tobytes(), name
    assert again.events == whole.events
    assert [again.active_sets[i] for i in again.active_set] == [
        whole.active_sets[i] for i in whole.active_set
    ]


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


@pytest.mark.parametrize("old", ["varint checkpoint 3", "varint checkpoint 4"])
def test_checkpoints_of_before_are_refused_by_their_format(tmp_path, old):
    start = dict(q0=1.0, v0=0.0, h=0.01, steps=2000, checkpoint=tmp_path / "run")
    vi.simulate(pendulum(), **start)
    with np.load(tmp_path / "run") as data:
        arrays = dict(data)
    header = json.loads(str(arrays["header"])) | {"format": old}
    with (tmp_path / "run").open("wb") as file:
        np.savez(file, **arrays | {"header": np.array(json.dumps(header))})
    with pytest.raises(vi.InputError, match=f"'{old}', not 'varint checkpoint 5'; move it away"):
        vi.simulate(pendulum(), **start)
