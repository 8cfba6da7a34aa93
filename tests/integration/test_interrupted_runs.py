"""Runs are stepped in blocks: Ctrl-C ends them between two, and their lengths show in nothing."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from scenes import double_pendulum
from stopped_runs import assert_same_bytes, stopped_after

import varint as vi
from varint.integration.interpreted_loop import next_block


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
        assert_same_bytes(whole, again)


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
        "save_every=every, backend=backend)\nvi.simulate(scene, rule, steps=3000, **start | "
        "dict(save_every=min(every, 1000)))\nthreading.Timer(2.0, lambda: os.kill(os.getpid(), "
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
