"""Runs that were killed or stopped go on from their checkpoint to the bytes of one that was not."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from saved_files import parts_of
from scenes import pendulum, rocking
from stopped_runs import assert_same_bytes, simulate_until_stopped

import varint as vi
from varint.integration import checkpoint as module
from varint.integration.events import flights

KILLED = r"""
import json, os, random, signal, sys, time
sys.path[:0] = sys.argv[1:3]
import numpy as np
import varint as vi
from scenes import double_pendulum, rocking
from varint.integration import checkpoint, compiled_loop
from varint.integration.events import flights

checkpoint.PAUSE, checkpoint.MOST_SHARE = 0.0, 1e9  # after every block
compiled_loop.STEPS_IN_BLOCK = 2000
flights.PATIENCE = 0.0
folder, seed, kind = sys.argv[3], int(sys.argv[4]), sys.argv[5]
scene, moments = rocking() if kind == "contacts" else double_pendulum(), random.Random(seed)
rule = None if kind == "contacts" else vi.gauss(2)
if kind == "contacts":
    start = dict(q0=[1.0, 0.5, 1.2], v0=[1.5, 0, 0], h=0.01, steps=50_000, save_every=9)
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
share = 1.5 if kind == "contacts" else 0.3  # its flights are short beside the files after them
path, kills, resumed = os.path.join(folder, "run.checkpoint"), 0, set()
while kills < 20:
    child = os.fork()
    if not child:
        run(path)
        os._exit(0)
    time.sleep(moments.uniform(0.0, share) * length)
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
@pytest.mark.parametrize(
    "kind", ["interpreted", "compiled", pytest.param("contacts", marks=pytest.mark.long)]
)
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
    assert_same_bytes(whole, killed)


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
    simulate_until_stopped(monkeypatch, 2, system, rule, checkpoint=path, **start)
    assert 0 < module.Checkpoint(path, parts_of(path)[0]["identity"]).read()[-1].after.k < 5000
    again = vi.simulate(system, rule, checkpoint=path, **start)
    assert_same_bytes(whole, again)


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
    whole = vi.simulate(stiff, vi.gauss(3), **start)
    simulate_until_stopped(
        monkeypatch, 15, stiff, vi.gauss(3), checkpoint=tmp_path / "run", **start
    )
    header, arrays = parts_of(tmp_path / "run")
    assert "carry" in arrays and header["by_newton"] and header["k"] < 60_000
    again = vi.simulate(stiff, vi.gauss(3), checkpoint=tmp_path / "run", **start)
    assert_same_bytes(whole, again)


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
    simulate_until_stopped(monkeypatch, blocks, model.system, vi.gauss(4), checkpoint=path, **start)
    again = vi.simulate(model.system, vi.gauss(4), checkpoint=path, **start)
    assert_same_bytes(whole, again)


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
    simulate_until_stopped(
        monkeypatch, 3, kepler, vi.gauss(4), checkpoint=tmp_path / "run", **start
    )
    with pytest.warns(UserWarning, match="h = 0.02 is too large"):
        again = vi.simulate(kepler, vi.gauss(4), checkpoint=tmp_path / "run", **start)
    assert again.events == whole.events
    assert_same_bytes(whole, again)


def test_a_run_that_is_done_comes_back_at_once(tmp_path, monkeypatch):
    start = dict(q0=1.0, v0=0.0, h=0.01, steps=2000, checkpoint=tmp_path / "run")
    first = vi.simulate(pendulum(), **start)

    def never(*arguments):
        raise AssertionError("the run was stepped again")

    monkeypatch.setattr("varint.integration.interpreted_loop.call", never)
    again = vi.simulate(pendulum(), **start)
    assert again.q.tobytes() == first.q.tobytes()


@pytest.mark.parametrize("every", [1, 7])
@pytest.mark.parametrize(("blocks", "patience"), [(3, 0.2), (10, 0.0), (30, 0.0)])
def test_a_run_with_contacts_goes_on_from_its_checkpoint(
    tmp_path, monkeypatch, every, blocks, patience
):
    """Also from within a call of the core in which what holds changes, and from many short ones."""
    start = dict(q0=[1.0, 0.5, 1.2], v0=[1.5, 0, 0], h=0.01, steps=600, save_every=every)
    whole = vi.simulate(rocking(), **start)
    assert len(whole.events) > 5 and len(whole.active_sets) > 1
    monkeypatch.setattr(flights, "PATIENCE", patience)
    simulate_until_stopped(monkeypatch, blocks, rocking(), checkpoint=tmp_path / "run", **start)
    assert 0 <= parts_of(tmp_path / "run")[0]["k"] < 600
    again = vi.simulate(rocking(), checkpoint=tmp_path / "run", **start)
    assert_same_bytes(whole, again, "v", "multipliers")
    assert again.events == whole.events
    assert [again.active_sets[i] for i in again.active_set] == [
        whole.active_sets[i] for i in whole.active_set
    ]
