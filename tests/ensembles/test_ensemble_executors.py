"""Ensembles on threads, processes and clusters, on disk, and after the loss of workers."""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
import tracemalloc
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from scenes import double_pendulum, henon_heiles

import varint as vi
from varint.ensembles import executor as module
from varint.ensembles import result, zarr_store

START = dict(v0=[0, 0], h=0.02, steps=200, backend="interpreted")


@pytest.fixture
def small_chunks(monkeypatch):
    """Chunks of a few members, so that there are many."""
    monkeypatch.setattr(module, "SECONDS", 1e-9)
    monkeypatch.setattr(module, "MOST_NUMBERS", 10_000)


def starts(count: int) -> np.ndarray:
    return np.random.default_rng(6).normal(size=(count, 2))


def assert_same(one: vi.Ensemble, other: vi.Ensemble) -> None:
    assert one.q.tobytes() == other.q.tobytes() and one.p.tobytes() == other.p.tobytes()


def test_threads_and_processes_give_the_bits_of_one_process():
    system, q0 = double_pendulum(), starts(60)
    plain = vi.ensemble(system, q0=q0, **START)
    with ThreadPoolExecutor(3) as pool:
        assert_same(vi.ensemble(system, q0=q0, executor=pool, **START), plain)
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:
        there = vi.ensemble(system, q0=q0, executor=pool, **START)
    assert_same(there, plain)
    assert len(there.chunks) > 4


class Losing(Executor):
    """Loses every second chunk once, as a cluster does whose workers die."""

    def __init__(self, error: type[BaseException], always: bool = False):
        self.error, self.always, self.seen, self.count = error, always, set(), 0

    def submit(self, function, what, members):
        future: Future = Future()
        self.count += 1
        if self.always or (members.first not in self.seen and self.count % 2):
            self.seen.add(members.first)
            future.set_exception(self.error("worker lost"))
        else:
            future.set_result(function(what, members))
        return future


@pytest.mark.parametrize("error", [ConnectionError, EOFError])
def test_chunks_of_lost_workers_are_done_again_each_member_once(small_chunks, error):
    system, q0 = double_pendulum(), starts(120)
    plain = vi.ensemble(system, q0=q0, **START)
    pool = Losing(error)
    motions = vi.ensemble(system, q0=q0, executor=pool, **START)
    assert len(pool.seen) > 3
    assert_same(motions, plain)
    assert [c.first for c in motions.chunks] == np.cumsum([0, *(len(c) for c in motions.chunks)])[
        :-1
    ].tolist()


def test_a_chunk_that_is_lost_again_and_again_ends_in_an_error_that_names_its_members():
    with pytest.raises(
        vi.VarintError, match=r"members \d+ to \d+ were lost with their workers 4 times"
    ):
        vi.ensemble(
            double_pendulum(), q0=starts(40), executor=Losing(ConnectionError, always=True), **START
        )
    with pytest.raises(ZeroDivisionError):  # an error of the work itself is no loss
        vi.ensemble(double_pendulum(), q0=starts(40), executor=Losing(ZeroDivisionError), **START)


@pytest.mark.skipif(sys.platform == "win32", reason="needs SIGKILL")
def test_a_pool_whose_process_is_killed_is_replaced(small_chunks):
    system, q0 = double_pendulum(), starts(400)
    plain = vi.ensemble(system, q0=q0, **START)
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:
        pool.submit(os.getpid).result()
        victim = next(iter(pool._processes))
        killer = threading.Timer(0.3, os.kill, (victim, signal.SIGKILL))
        killer.start()
        motions = vi.ensemble(system, q0=q0, executor=pool, **START)
        killer.join()
        with pytest.raises(Exception, match=r"terminated abruptly|unusable"):
            pool.submit(os.getpid).result()
    assert_same(motions, plain)


@pytest.mark.skipif(sys.platform == "win32", reason="needs SIGKILL")
@pytest.mark.filterwarnings("ignore")  # of the cluster's own about its killed worker
def test_a_dask_cluster_that_loses_a_worker_returns_every_member_once(small_chunks, tmp_path):
    distributed = pytest.importorskip(
        "distributed", reason="needs the extra: pip install varint-mechanics[distributed]"
    )
    system, q0 = double_pendulum(), starts(300)
    plain = vi.ensemble(system, q0=q0, **START)
    options = dict(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    )
    with (
        distributed.LocalCluster(local_directory=str(tmp_path / "dask"), **options) as cluster,
        distributed.Client(cluster) as client,
    ):
        pids = client.run(os.getpid)
        killer = threading.Timer(0.4, os.kill, (next(iter(pids.values())), signal.SIGKILL))
        killer.start()
        motions = vi.ensemble(
            system, q0=q0, executor=client.get_executor(), store=tmp_path / "kept", **START
        )
        killer.join()
        deadline = time.monotonic() + 30
        while len(now := client.run(os.getpid)) < 2 and time.monotonic() < deadline:
            time.sleep(0.1)
        assert set(now.values()) != set(pids.values()), "the worker was not killed"
    assert_same(motions, plain)
    members = [i for first, count in motions.chunks.ranges for i in range(first, first + count)]
    assert members == list(range(300))


def test_a_store_is_bounded_in_memory_and_reads_like_the_arrays(small_chunks, tmp_path):
    system, q0 = henon_heiles(), starts(50) / 10
    plain = vi.ensemble(system, q0=q0, **START)
    kept = vi.ensemble(system, q0=q0, store=tmp_path / "kept", **START)
    assert len(kept.chunks) > 5 and max(len(chunk) for chunk in kept.chunks) < 20
    assert_same(kept, plain)
    for i in (0, 17, 49):
        assert kept[i].q.tobytes() == plain[i].q.tobytes()
    np.testing.assert_array_equal(kept.mean(system.q[0]), plain.mean(system.q[0]))
    again = vi.load(tmp_path / "kept")
    assert_same(again, plain)
    assert again[3].energy == pytest.approx(plain[3].energy, abs=1e-15)


@pytest.mark.parametrize("kind", ["kept", "kept.zarr"])
def test_a_store_bounds_the_memory_of_an_ensemble_that_is_larger(tmp_path, monkeypatch, kind):
    """5 MB of coordinates and momenta, made, averaged and ranked within 3."""
    if kind.endswith("zarr"):
        pytest.importorskip("zarr", reason="needs the extra: pip install varint-mechanics[zarr]")
    monkeypatch.setattr(module, "MOST_NUMBERS", 40_000)
    monkeypatch.setattr(zarr_store, "MOST_NUMBERS", 40_000)
    monkeypatch.setattr(result, "MOST_NUMBERS", 100_000)
    system, rule = henon_heiles(), vi.gauss(2)
    start = dict(v0=[0, 0], h=0.02, steps=500, backend="compiled")

    def peak(count: int, **store) -> tuple[float, tuple]:
        """Megabytes in use at most, and statistics."""
        tracemalloc.start()
        motions = vi.ensemble(system, rule, q0=starts(count) / 10, **store, **start)
        low, high = motions.quantiles(system.q[0], (0.05, 0.95))
        found = (
            motions.mean(system.q[0]).tobytes(),
            motions.std(system.v[1]).tobytes(),
            low.tobytes(),
            high.tobytes(),
        )
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return most / 2**20, found

    peak(8)  # builds the functions
    (less, kept), (more, plain) = peak(300, store=tmp_path / kind), peak(300)
    assert less < 3 and more > 5, (less, more)
    assert kept == plain, "the statistics depend on where the members are kept"


def stopped_after_four(monkeypatch) -> list[int]:
    """Ctrl-C after four chunks; the first members of those that are done."""
    stepped, done = module.step_chunk, []

    def interrupted(system, rule, members, backend):
        if len(done) == 4:
            raise KeyboardInterrupt
        done.append(members.first)
        return stepped(system, rule, members, backend)

    monkeypatch.setattr(module, "step_chunk", interrupted)
    return done


def test_a_zarr_group_keeps_an_ensemble_and_an_interrupted_one_goes_on(
    small_chunks, tmp_path, monkeypatch
):
    zarr = pytest.importorskip("zarr", reason="needs the extra: pip install varint-mechanics[zarr]")
    system, q0 = double_pendulum(), starts(53)
    plain = vi.ensemble(system, q0=q0, **START)
    where = tmp_path / "kept.zarr"
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        done = stopped_after_four(patch)
        vi.ensemble(system, q0=q0, store=where, **START)
    with pytest.raises(vi.InputError, match="not complete"):
        vi.load(where)
    before, seen, stepped = set(done), [], module.step_chunk

    def counted(system, rule, members, backend):
        seen.append(members.first)
        return stepped(system, rule, members, backend)

    monkeypatch.setattr(module, "step_chunk", counted)
    again = vi.ensemble(system, q0=q0, store=where, **START)
    assert_same(again, plain)
    assert seen and not before & set(seen), "a chunk was done twice"
    assert_same(vi.load(where), plain)
    np.testing.assert_array_equal(zarr.open_group(str(where), mode="r")["q"][:], plain.q)
    with pytest.raises(vi.InputError, match=r"holds another ensemble: it differs in \['q0'\]"):
        vi.ensemble(system, q0=q0 + 1, store=where, **START)
    group = zarr.group(zarr.storage.MemoryStore())
    assert_same(vi.ensemble(system, q0=q0, store=group, **START), plain)
    foreign = zarr.open_group(str(tmp_path / "foreign.zarr"), mode="w")
    foreign.create_array("mine", shape=(3,), dtype="f8")
    with pytest.raises(vi.InputError, match="not empty and holds no ensemble"):
        vi.ensemble(system, q0=q0, store=tmp_path / "foreign.zarr", **START)
    chunk = next(
        path for path in (where / "q").rglob("*") if path.is_file() and path.name != "zarr.json"
    )
    whole, refused = chunk.read_bytes(), 0
    for i in range(20, len(whole), len(whole) // 9):
        chunk.write_bytes(whole[:i] + bytes([whole[i] ^ 4]) + whole[i + 1 :])
        try:
            assert_same(vi.load(where), plain)  # a bit that nothing reads
        except vi.InputError as error:
            assert "torn or not from varint" in str(error)
            refused += 1
    assert refused >= 7
    chunk.write_bytes(chunk.read_bytes()[:20])
    with pytest.raises(vi.InputError, match="torn or not from varint"):
        _ = vi.load(where).q


def test_without_zarr_the_message_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "zarr", None)
    with pytest.raises(vi.InputError, match=r"pip install varint-mechanics\[zarr\]"):
        vi.ensemble(double_pendulum(), q0=starts(3), store=tmp_path / "kept.zarr", **START)
    with pytest.raises(vi.InputError, match="store must be the path"):
        vi.ensemble(double_pendulum(), q0=starts(3), store=7, **START)


MPI = r"""
import numpy as np, varint as vi
from mpi4py.futures import MPIPoolExecutor
from scenes import double_pendulum
from varint.ensembles import executor

if __name__ == "__main__":
    executor.SECONDS = 1e-9
    q0 = np.random.default_rng(6).normal(size=(100, 2))
    start = dict(q0=q0, v0=[0, 0], h=0.02, steps=200, backend="interpreted")
    plain = vi.ensemble(double_pendulum(), **start)
    with MPIPoolExecutor() as pool:
        there = vi.ensemble(double_pendulum(), executor=pool, **start)
    same = (there.q.tobytes() == plain.q.tobytes(), there.p.tobytes() == plain.p.tobytes())
    print(len(there.chunks) > 4, *same)
"""


def test_a_pool_of_mpi_processes_gives_the_bits_of_one_process(tmp_path):
    pytest.importorskip("mpi4py", reason="needs the extra: pip install varint-mechanics[mpi]")
    beside = os.path.dirname(sys.executable)
    launcher = shutil.which("mpiexec", path=os.pathsep.join([beside, os.environ.get("PATH", "")]))
    if launcher is None:
        pytest.skip("no mpiexec")
    here, script = str(Path(__file__).resolve().parents[1]), tmp_path / "pool.py"
    script.write_text(MPI)
    call = [launcher, "-n", "3", sys.executable, "-m", "mpi4py.futures", str(script)]
    there = os.environ | {"PYTHONPATH": os.pathsep.join([os.path.dirname(here), here])}
    done = subprocess.run(call, capture_output=True, text=True, timeout=120, env=there)
    assert done.stdout.split() == ["True"] * 3, done.stderr


@pytest.mark.filterwarnings("ignore")  # of loky's own
def test_other_kinds_of_pools_work_too():
    loky = pytest.importorskip("loky", reason="needs the package loky")
    system, q0 = double_pendulum(), starts(60)
    plain = vi.ensemble(system, q0=q0, **START)
    pool = loky.get_reusable_executor(max_workers=2)
    try:
        assert_same(vi.ensemble(system, q0=q0, executor=pool, **START), plain)
        victim = next(iter(pool._processes))
        os.kill(victim, getattr(signal, "SIGKILL", signal.SIGTERM))
        assert_same(vi.ensemble(system, q0=q0, executor=pool, **START), plain)
    finally:
        pool.shutdown(wait=True, kill_workers=True)


def test_an_interrupted_ensemble_goes_on_where_it_was(small_chunks, tmp_path, monkeypatch):
    system, q0 = double_pendulum(), starts(50)
    plain = vi.ensemble(system, q0=q0, **START)
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        stopped_after_four(patch)
        vi.ensemble(system, q0=q0, store=tmp_path / "kept", **START)
    with pytest.raises(vi.InputError, match="not complete"):
        vi.load(tmp_path / "kept")
    (tmp_path / "kept" / "members_0000000049_0000001.npz.part").write_bytes(b"killed while writing")
    before = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "kept").glob("*.npz")}
    assert len(before) == 5
    again = vi.ensemble(system, q0=q0, store=tmp_path / "kept", **START)
    assert_same(again, plain)
    assert {name: (tmp_path / "kept" / name).stat().st_mtime_ns for name in before} == before, (
        "a chunk was done twice"
    )


def test_torn_and_foreign_stores_are_refused(tmp_path):
    system, q0 = double_pendulum(), starts(5)
    vi.ensemble(system, q0=q0, store=tmp_path / "kept", **START)
    with pytest.raises(vi.InputError, match=r"holds another ensemble: it differs in \['q0'\]"):
        vi.ensemble(system, q0=q0 + 1, store=tmp_path / "kept", **START)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.txt").write_text("mine")
    with pytest.raises(vi.InputError, match="not empty and holds no ensemble"):
        vi.ensemble(system, q0=q0, store=tmp_path / "full", **START)
    chunk = next((tmp_path / "kept").glob("members_*"))
    chunk.write_bytes(chunk.read_bytes()[:300])
    with pytest.raises(vi.InputError, match="torn or not from varint"):
        _ = vi.ensemble(system, q0=q0, store=tmp_path / "kept", **START).q


def test_runs_in_threads_give_the_results_of_runs_in_sequence():
    """Systems, functions and runs of several scenes made at once: nothing that one thread does
    shows in another.
    """

    def one(i: int) -> bytes:
        q, v = vi.coordinates("x", "y")
        scenes = [
            lambda: vi.System(q, v, ca.sumsqr(v) / 2 - ca.sumsqr(q) ** 2),
            lambda: vi.System(q, v, ca.sumsqr(v) / 2 * (1 + q[0] ** 2) + ca.cos(q[1] - q[0])),
            lambda: vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[1], constraint=ca.sumsqr(q) - 1),
        ]
        system = scenes[i % 3]()
        motion = vi.simulate(system, q0=[0.6, 0.8], v0=[0.8, -0.6], h=0.01, steps=500 + 7 * i)
        return (
            motion.q.tobytes()
            + motion.energy.tobytes()
            + motion.at(motion.t[1:5] - 0.003).p.tobytes()
        )

    sequence = [one(i) for i in range(18)]
    with ThreadPoolExecutor(6) as pool:
        assert list(pool.map(one, range(18))) == sequence


def test_threads_that_share_a_system_give_the_results_of_runs_in_sequence():
    shared = double_pendulum()

    def one(i: int, system: vi.System) -> bytes:
        motion = vi.simulate(system, vi.gauss(2), q0=[0.1 * i, 0.2], v0=[0, 0], h=0.01, steps=1000)
        return motion.p.tobytes() + motion.v.tobytes()

    with ThreadPoolExecutor(6) as pool:
        together = list(pool.map(one, range(12), [shared] * 12))
    fresh = double_pendulum()
    assert together == [one(i, fresh) for i in range(12)]
