"""Nothing lasts long without a word where someone watches."""

import re
import time

import casadi as ca
import pytest

import varint as vi
from varint.codegen import cache
from varint.numerics import progress


@pytest.fixture
def watched(monkeypatch):
    monkeypatch.setattr(progress, "_is_watched", lambda: True)
    monkeypatch.setattr(progress, "SILENCE", 0.02)


def test_long_work_says_what_it_does_and_for_how_long(watched, capsys):
    with progress.notice("thinking"):
        time.sleep(0.2)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) >= 2 and all(re.fullmatch(r"thinking: \d+ s", line) for line in lines)


def test_short_work_and_work_that_nobody_watches_say_nothing(watched, monkeypatch, capsys):
    monkeypatch.setattr(progress, "SILENCE", 10.0)
    with progress.notice("thinking"):
        pass
    monkeypatch.setattr(progress, "SILENCE", 0.01)
    monkeypatch.setattr(progress, "_is_watched", lambda: False)
    with progress.notice("thinking"):
        time.sleep(0.1)
    assert capsys.readouterr().err == ""


def test_an_error_ends_the_notice(watched, capsys):
    with pytest.raises(ZeroDivisionError), progress.notice("thinking"):
        raise ZeroDivisionError
    time.sleep(0.1)
    assert capsys.readouterr().err == ""


@pytest.mark.skipif(cache.compiler() is None, reason="no C compiler")
def test_a_long_compilation_is_announced(watched, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    cache.library.cache_clear()
    q, v = vi.coordinates("x")
    scene = vi.System(q, v, v**2 / 2 - ca.cosh(q))
    vi.simulate(scene, vi.gauss(2), q0=1.0, v0=0.0, h=0.01, steps=5, backend="compiled")
    cache.library.cache_clear()
    assert "compiling gauss(2)" in capsys.readouterr().err
