"""The cache of compiled code: private, atomic, shared by processes, never fed by others."""

import os
import stat
import subprocess
import sys

import pytest

from varint.compiled import cache

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
    script = f"from varint.compiled import cache; cache.library({SOURCE!r})"
    subprocess.run([sys.executable, "-c", script], check=True)
    (file,) = home.iterdir()
    file.write_bytes(file.read_bytes()[:3000])
    assert cache.library(SOURCE).answer() == 42


def test_processes_that_compile_the_same_source_at_once_do_not_disturb_each_other(home):
    script = f"from varint.compiled import cache; assert cache.library({SOURCE!r}).answer() == 42"
    started = [subprocess.Popen([sys.executable, "-c", script], stderr=subprocess.PIPE) for _ in range(4)]
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
    assert os.path.realpath(cache.compiler()[0]) in key and cache._processor() in key and "-march=native" in key
