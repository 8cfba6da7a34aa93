"""Disks that are full, folders that cannot be written, and writers that are killed: the old file
stays until the new one is whole, and a run goes on.
"""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from scenes import double_pendulum, henon_heiles, pendulum

import varint as vi
from varint.integration import checkpoint
from varint.numerics import archive
from varint.numerics.files import write_atomically

ROOT = Path(__file__).resolve().parents[2]


class Filling:
    """A file on a disk that is full after some bytes."""

    def __init__(self, file, room: int):
        self.file, self.room = file, room

    def write(self, data) -> int:
        size = memoryview(data).nbytes
        if size > self.room:
            self.file.write(bytes(memoryview(data).cast("B")[: self.room]))
            self.room = 0
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self.room -= size
        return self.file.write(data)

    def __getattr__(self, name):
        return getattr(self.file, name)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.file.close()


def fill(monkeypatch, room: int) -> None:
    """Every new file has room for so many bytes."""
    opened = Path.open

    def narrow(self, mode="r", *more, **kinds):
        file = opened(self, mode, *more, **kinds)
        return Filling(file, room) if "w" in mode else file

    monkeypatch.setattr(Path, "open", narrow)


def motion_of(steps: int = 50) -> vi.Trajectory:
    return vi.simulate(henon_heiles(), q0=[0.1, 0.2], v0=[0, 0.1], h=0.1, steps=steps)


@pytest.mark.parametrize("room", [0, 1, 100, 1000, 2000])
def test_a_full_disk_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch, room):
    path = tmp_path / "run.npz"
    motion_of(20).save(path)
    before = path.read_bytes()
    with monkeypatch.context() as patch:
        fill(patch, room)
        with pytest.raises(vi.InputError, match="No space left"):
            motion_of().save(path)
    assert path.read_bytes() == before and os.listdir(tmp_path) == ["run.npz"]
    motion_of().save(path)
    assert len(vi.load(path)) == 51


@pytest.mark.parametrize("what", ["fsync", "replace"])
def test_a_disk_that_fails_at_the_end_leaves_the_old_file_too(tmp_path, monkeypatch, what):
    """Some file systems find out that there is no room only when all is to be on the disk."""
    path = tmp_path / "run.npz"
    motion_of(20).save(path)
    before = path.read_bytes()

    def full(*arguments):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(*((os, "fsync") if what == "fsync" else (Path, "replace")), full)
        with pytest.raises(vi.InputError, match="No space left"):
            motion_of().save(path)
    assert path.read_bytes() == before and os.listdir(tmp_path) == ["run.npz"]


def test_ctrl_c_while_a_file_is_written_leaves_the_old_one(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(b"old")

    def interrupted(file):
        file.write(b"half of the n")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_atomically(path, interrupted)
    assert path.read_bytes() == b"old" and os.listdir(tmp_path) == ["a"]


@pytest.mark.skipif(os.name != "posix", reason="needs links and modes")
def test_links_and_modes_stay_what_they_are(tmp_path):
    (tmp_path / "real").mkdir()
    target, link = tmp_path / "real" / "run.npz", tmp_path / "link.npz"
    target.touch(mode=0o600)
    link.symlink_to(target)
    motion_of().save(link)
    assert link.is_symlink() and target.stat().st_mode & 0o777 == 0o600
    assert len(vi.load(target)) == 51


def test_writers_of_one_file_at_once_do_not_mix(tmp_path):
    path, seen = tmp_path / "a", []

    def write(letter: bytes):
        for _ in range(30):
            write_atomically(path, lambda file: [file.write(letter * 1000) for _ in range(20)])
            seen.append(path.read_bytes())

    threads = [threading.Thread(target=write, args=(letter,)) for letter in (b"a", b"b", b"c")]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(seen) == 90
    assert all(len(x) == 20_000 and len(set(x)) == 1 for x in seen)
    assert os.listdir(tmp_path) == ["a"]


LIMITED = r"""
import json, os, resource, sys, warnings
import varint as vi
from scenes import henon_heiles
from varint.integration import checkpoint

checkpoint.PAUSE = 0.0
checkpoint.MOST_SHARE = 1e9
folder, start = sys.argv[1], dict(q0=[0.1, 0.2], v0=[0, 0.1], h=0.1, backend="interpreted")
system, rule = henon_heiles(), vi.gauss(2)
whole = vi.simulate(system, rule, steps=4000, **start)
path = os.path.join(folder, "run.npz")
vi.simulate(system, rule, steps=20, **start).save(path)
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
try:
    whole.save(path)
    print("saved")
except vi.InputError as error:
    print("refused", len(vi.load(path)))
with warnings.catch_warnings(record=True) as said:
    warnings.simplefilter("always")
    motion = vi.simulate(system, rule, steps=4000, checkpoint=os.path.join(folder, "c"), **start)
print(motion.q.tobytes() == whole.q.tobytes(), len(motion), motion.stats["interrupted"])
print([str(x.message)[:41] for x in said], sorted(os.listdir(folder)))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="needs limits on the size of files")
def test_a_real_limit_ends_no_run_and_destroys_no_file(tmp_path):
    call = [sys.executable, "-c", LIMITED, str(tmp_path)]
    paths = os.pathsep.join([str(ROOT), str(ROOT / "tests")])
    done = subprocess.run(
        call, capture_output=True, text=True, timeout=120, env=os.environ | {"PYTHONPATH": paths}
    )
    assert done.returncode == 0, done.stderr
    saved, run, said = done.stdout.splitlines()
    assert saved == "refused 21"
    assert run == "True 4001 False"
    assert said.startswith("['the run goes on without its checkpoint: c'] ['c', 'run.npz']")


@pytest.mark.parametrize("backend", ["interpreted", "compiled"])
def test_a_run_whose_checkpoint_meets_a_full_disk_goes_on_and_says_it_once(
    tmp_path, monkeypatch, backend
):
    from varint.integration import compiled_loop

    monkeypatch.setattr(checkpoint, "PAUSE", 0.0)
    monkeypatch.setattr(checkpoint, "MOST_SHARE", 1e9)
    monkeypatch.setattr(compiled_loop, "NODES_IN_BLOCK", 500)
    start = dict(q0=[0.4, 0.2], v0=[0, 0], h=0.01, steps=6000, backend=backend)
    whole = vi.simulate(double_pendulum(), vi.gauss(2), **start)
    path = tmp_path / "run"
    with monkeypatch.context() as patch:
        fill(patch, 60_000)
        with pytest.warns(UserWarning, match="goes on without its checkpoint.*No space") as said:
            motion = vi.simulate(double_pendulum(), vi.gauss(2), checkpoint=path, **start)
    assert len(said) == 1 and __file__ == said[0].filename
    assert motion.q.tobytes() == whole.q.tobytes() and motion.p.tobytes() == whole.p.tobytes()
    assert motion.stats["residual"] == whole.stats["residual"]
    assert os.listdir(tmp_path) == ["run"], "the last whole checkpoint"
    again = vi.simulate(double_pendulum(), vi.gauss(2), checkpoint=path, **start)
    assert again.q.tobytes() == whole.q.tobytes()


def test_a_run_with_no_memory_for_its_checkpoint_goes_on(tmp_path, monkeypatch):
    def greedy(*arguments, **more):
        raise MemoryError

    monkeypatch.setattr(checkpoint, "write_archive", greedy)
    start = dict(q0=1.0, v0=0.0, h=0.01, steps=2000)
    with pytest.warns(UserWarning, match="goes on without its checkpoint: no memory"):
        motion = vi.simulate(pendulum(), checkpoint=tmp_path / "run", **start)
    assert motion.q.tobytes() == vi.simulate(pendulum(), **start).q.tobytes()
    assert not os.listdir(tmp_path)


@pytest.mark.parametrize("why", ["No space", "no memory is left", "no text of at most"])
def test_a_motion_that_cannot_be_kept_is_returned_all_the_same(tmp_path, monkeypatch, why):
    system, path = double_pendulum(), tmp_path / "run"
    start = dict(q0=[0.4, 0.2], v0=[0, 0], duration=20.0, events={"zero": double_pendulum().q[0]})
    whole = vi.simulate(system, **start)

    def greedy(*arguments, **more):
        raise MemoryError

    with monkeypatch.context() as patch:
        if why == "No space":
            fill(patch, 5_000)
        elif why == "no memory is left":
            patch.setattr(checkpoint, "write_archive", greedy)
        else:  # too many events for a header that is read again
            patch.setattr(archive, "MOST_HEADER", 5_000)
        with pytest.warns(UserWarning, match=f"not kept in its checkpoint.*{why}") as said:
            motion = vi.simulate(system, **start, checkpoint=path)
    assert len(said) == 1 and __file__ == said[0].filename
    assert motion.q.tobytes() == whole.q.tobytes() and motion.events == whole.events
    assert not os.listdir(tmp_path)
    again = vi.simulate(system, **start, checkpoint=path)
    assert path.exists() and again.q.tobytes() == whole.q.tobytes()


@pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write everywhere"
)
def test_a_folder_that_cannot_be_written_is_refused_before_the_run(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(vi.InputError, match="cannot be written"):
        vi.simulate(pendulum(), q0=1, v0=0, h=0.1, steps=10, checkpoint=tmp_path / "run")


def test_what_a_killed_run_left_beside_its_checkpoint_is_removed(tmp_path):
    start = dict(q0=1.0, v0=0.0, h=0.01, steps=2000, checkpoint=tmp_path / "run")
    vi.simulate(pendulum(), **start)
    (tmp_path / "run.123-456.part").write_bytes(b"killed while writing")
    (tmp_path / "running.part").write_bytes(b"of somebody else")
    vi.simulate(pendulum(), **start)
    assert sorted(os.listdir(tmp_path)) == ["run", "running.part"]


def test_an_ensemble_on_a_full_disk_keeps_the_chunks_that_are_whole(tmp_path, monkeypatch):
    q0 = np.linspace(0, 0.3, 80).reshape(40, 2)
    start = dict(q0=q0, v0=[0, 0], h=0.1, steps=20, backend="interpreted")
    plain = vi.ensemble(henon_heiles(), **start)
    count, where = [0], tmp_path / "kept"
    opened = Path.open

    def narrow(self, mode="r", *more, **kinds):
        file = opened(self, mode, *more, **kinds)
        count[0] += "w" in mode
        return Filling(file, 1000) if "w" in mode and count[0] > 2 else file

    with monkeypatch.context() as patch:
        patch.setattr(Path, "open", narrow)
        with pytest.raises(vi.InputError, match="No space left"):
            vi.ensemble(henon_heiles(), store=where, **start)
    assert len(list(where.iterdir())) == 2 and not list(where.glob("*.part"))
    assert vi.ensemble(henon_heiles(), store=where, **start).q.tobytes() == plain.q.tobytes()
