"""The cache of compiled code: private, atomic, shared by processes, never fed by others."""

import errno
import os
import stat
import subprocess
import sys
import tempfile
import time
import warnings

import casadi as ca
import pytest

import varint as vi
from varint.codegen import cache, processes, source
from varint.integration import backend, compiled_loop, few_steps

pytestmark = pytest.mark.skipif(cache.compiler() is None, reason="no C compiler")
SOURCE = "int answer(void) { return 42; }\n"


@pytest.fixture
def home(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    cache.library.cache_clear()
    yield tmp_path / "varint"
    cache.library.cache_clear()


def test_a_source_is_compiled_once_into_a_private_folder(home):
    assert cache.library(SOURCE).answer() == 42
    (file,) = home.iterdir()
    assert stat.S_IMODE(home.stat().st_mode) == 0o700 and stat.S_IMODE(file.stat().st_mode) == 0o700
    written = file.stat().st_mtime_ns
    cache.library.cache_clear()
    assert cache.library(SOURCE).answer() == 42
    assert file.stat().st_mtime_ns == written and len(list(home.iterdir())) == 1


def test_another_source_or_flag_is_another_file(home, monkeypatch):
    cache.library(SOURCE)
    cache.library(SOURCE + "\n")
    assert len(list(home.iterdir())) == 2
    monkeypatch.setattr(cache, "machine", lambda: "another compiler")
    cache.library.cache_clear()
    cache.library(SOURCE)
    assert len(list(home.iterdir())) == 3


def test_several_are_compiled_at_the_same_time_and_once(home, monkeypatch):
    begun, begin = [], cache.begin_compilation

    def noted(text, contraction):
        begun.append(text)
        return begin(text, contraction)

    monkeypatch.setattr(source, "begin_compilation", noted)
    texts = [SOURCE.replace("42", str(number)) for number in (1, 2, 3, 4)]
    assert [x.answer() for x in source.libraries(texts)] == [1, 2, 3, 4]
    assert begun == texts[1:] and len(list(home.iterdir())) == 4
    cache.library.cache_clear()
    assert [x.answer() for x in source.libraries(texts)] == [1, 2, 3, 4]
    assert begun == texts[1:] and not cache._AT_WORK


def test_what_the_compiler_refuses_beside_another_is_named(home):
    with pytest.raises(cache.CompileError, match="refused"):
        source.libraries([SOURCE, "nonsense"])
    assert cache.library(SOURCE).answer() == 42


@pytest.mark.parametrize("mode", (0o770, 0o707))
def test_a_folder_that_others_may_write_to_is_refused(home, mode):
    home.mkdir()
    home.chmod(mode)
    with pytest.raises(cache.CompileError, match="XDG_CACHE_HOME"):
        cache.library(SOURCE)


def test_a_link_in_place_of_the_folder_is_refused(home, tmp_path):
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    home.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(cache.CompileError, match="link"):
        cache.library(SOURCE)


def test_a_file_that_others_may_write_to_is_refused(home):
    cache.library(SOURCE)
    (file,) = home.iterdir()
    file.chmod(0o722)
    cache.library.cache_clear()
    with pytest.raises(cache.CompileError, match="trusted"):
        cache.library(SOURCE)


def test_a_file_that_was_cut_short_is_compiled_again(home):
    script = f"from varint.codegen import cache; cache.library({SOURCE!r})"
    subprocess.run([sys.executable, "-c", script], check=True)
    (file,) = home.iterdir()
    file.write_bytes(file.read_bytes()[:3000])
    assert cache.library(SOURCE).answer() == 42


@pytest.mark.parametrize("place", (0.1, 0.5, 0.9))
def test_a_file_with_wrong_bytes_is_compiled_again(home, place):
    """Of the right length, as a crash before the bytes reach the disk leaves it."""
    script = f"from varint.codegen import cache; cache.library({SOURCE!r})"
    subprocess.run([sys.executable, "-c", script], check=True)
    (file,) = home.iterdir()
    content = bytearray(file.read_bytes())
    at = int(place * len(content))
    content[at : at + 64] = bytes(x ^ 0xFF for x in content[at : at + 64])
    file.write_bytes(content)
    assert cache.library(SOURCE).answer() == 42
    assert [x.read_bytes() != content for x in home.iterdir()] == [True]


def test_a_file_is_on_the_disk_and_under_its_last_name_before_it_is_loaded(home, monkeypatch):
    seen = []
    fsync, load = os.fsync, cache.ctypes.CDLL
    monkeypatch.setattr(cache.os, "fsync", lambda number: (seen.append("sync"), fsync(number)))
    monkeypatch.setattr(
        cache.ctypes, "CDLL", lambda path: (seen.append(os.listdir(home)), load(path))[1]
    )
    cache.library(SOURCE)
    (file,) = home.iterdir()
    assert seen == ["sync", [file.name]]


def test_a_compilation_that_is_killed_leaves_nothing_behind(home, tmp_path, monkeypatch):
    """Neither does one that is interrupted; what a crash left while writing is swept later."""
    slow = tmp_path / "slow"
    slow.write_text("#!/bin/sh\nsleep 30\n")
    slow.chmod(0o700)
    script = f"from varint.codegen import cache; cache.library({SOURCE!r})"
    environment = os.environ | {"CC": str(slow)}
    started = subprocess.Popen([sys.executable, "-c", script], env=environment)
    for _ in range(200):
        if home.exists():
            break
        time.sleep(0.05)
    time.sleep(0.3)
    started.kill()
    started.wait()
    assert list(home.iterdir()) == []
    old = home / f"{cache.PART}left"
    old.write_bytes(b"half")
    os.utime(old, (0, 0))
    cache.library(SOURCE)
    assert not old.exists() and len(list(home.iterdir())) == 1


@pytest.fixture
def endless(tmp_path, monkeypatch):
    """A compiler that starts another program, as they do, and comes to no end; where it says
    which.
    """
    slow = tmp_path / "slow"
    slow.write_text(
        f"#!/bin/sh\nsleep 60 & echo $! > {tmp_path}/its\n"
        f"touch ${{TMPDIR:-/tmp}}/half.s && mv {tmp_path}/its {tmp_path}/started\nwait\n"
    )
    slow.chmod(0o700)
    monkeypatch.setenv("CC", str(slow))
    monkeypatch.setenv("TMPDIR", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    return tmp_path / "started"


WAIT = "while not os.path.exists(sys.argv[1]): time.sleep(0.02)\n"
BEGIN = "cache.begin_compilation('')\n" + WAIT
INTERRUPTED = (
    f"def interrupt():\n    {WAIT}    os.kill(os.getpid(), signal.SIGINT)\n"
    "threading.Thread(target=interrupt).start()\ncache.library('')\n"
)


KILLED = INTERRUPTED.replace("SIGINT", "SIGKILL")  # no line of Python runs after that
TERMINATED = "cache.begin_compilation('')\n" + INTERRUPTED.replace("SIGINT", "SIGTERM")


@pytest.mark.skipif(sys.platform == "win32", reason="programs of a shell, and their groups")
@pytest.mark.parametrize(
    "what",
    [BEGIN, INTERRUPTED, KILLED, TERMINATED],
    ids=["background", "interrupted", "killed", "terminated"],
)
def test_compilers_and_what_they_started_end_with_the_process(endless, what):
    """At once: in the background it would hold up every script that ends before it."""
    script = f"import os, signal, sys, threading, time\nfrom varint.codegen import cache\n{what}"
    call = [sys.executable, "-c", script, str(endless)]
    subprocess.run(call, stderr=subprocess.DEVNULL, timeout=30, check=False)
    for _ in range(100):
        if not _runs(int(endless.read_text())):
            break
        time.sleep(0.05)
    else:
        pytest.fail("the compiler's own child goes on")
    for _ in range(100):  # a folder is removed after what wrote to it has ended
        if not (left := list((endless.parent / "temporary").iterdir())):
            break
        time.sleep(0.05)
    assert not left


def _runs(number: int) -> bool:
    state = subprocess.run(["ps", "-o", "stat=", "-p", str(number)], capture_output=True, text=True)
    return state.stdout.strip()[:1] not in ("", "Z")


def test_both_ways_to_compile_give_the_compiler_the_same_words(home, monkeypatch):
    """Else a kernel would have other digits compiled at once than in the background."""
    monkeypatch.setattr(cache, "newer_functions", lambda: False)
    monkeypatch.setattr(tempfile, "tempdir", str(home.parent))
    said = []
    monkeypatch.setattr(processes, "start", lambda line, place: said.append(line))
    monkeypatch.setattr(processes, "run", lambda line, *_: (said.append(line), (1, ""))[1])
    monkeypatch.setattr(cache, "_AT_WORK", [])
    cache.begin_compilation(SOURCE)
    with pytest.raises(cache.CompileError):
        cache.library(SOURCE)
    background, at_once = ([x for x in line if "varint-" not in x] for line in said[:2])
    assert background == at_once and "-DNO_NEWER_FUNCTIONS" in at_once


def _full(*_):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_full_disk_is_said_once_and_the_run_goes_on_interpreted(home, monkeypatch):
    q, v = vi.coordinates("x")
    scene = vi.System(q, v, v**2 / 2 - ca.cosh(q))
    start = {"q0": 1.0, "v0": 0.0, "h": 0.01, "steps": 20}
    monkeypatch.setattr(cache.os, "fsync", _full)
    monkeypatch.setattr(backend, "repays", lambda *_: True)
    monkeypatch.setattr(compiled_loop, "kernel_in_gear", lambda *_: None)
    monkeypatch.setattr(few_steps, "gears_of", lambda *_: None)
    with pytest.warns(UserWarning, match="No space left"):
        motion = vi.simulate(scene, vi.composition("verlet"), **start)
    assert motion.stats["backend"] == "interpreted"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        vi.simulate(scene, vi.composition("verlet"), **start)
    with pytest.raises(cache.CompileError, match="XDG_CACHE_HOME"):
        vi.simulate(scene, vi.composition("verlet"), **start, backend="compiled")
    assert list(home.iterdir()) == []


def test_processes_that_compile_the_same_source_at_once_do_not_disturb_each_other(home):
    script = f"from varint.codegen import cache; assert cache.library({SOURCE!r}).answer() == 42"
    started = [
        subprocess.Popen([sys.executable, "-c", script], stderr=subprocess.PIPE) for _ in range(4)
    ]
    assert [p.wait(timeout=100) for p in started] == [0] * 4
    for p in started:
        p.stderr.close()
    assert len(list(home.iterdir())) == 1


def test_a_refusal_of_the_compiler_is_a_short_error(home):
    with pytest.raises(cache.CompileError, match="interpreted") as caught:
        cache.library("this is not C")
    assert len(str(caught.value)) < 800
    assert list(home.iterdir()) == []


def test_without_a_compiler_the_error_says_what_to_do(home, monkeypatch):
    monkeypatch.setattr(cache, "compiler", lambda: None)
    cache.machine.cache_clear()
    try:
        with pytest.raises(cache.CompileError, match="jit"):
            cache.library(SOURCE)
    finally:
        cache.machine.cache_clear()


def test_the_processor_and_the_compiler_are_part_of_the_key():
    key = cache.machine()
    assert (
        os.path.realpath(cache.compiler()[0]) in key
        and cache._processor() in key
        and "-march=native" in key
    )
