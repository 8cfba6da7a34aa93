"""Ensembles whose steps are chosen on threads and processes, on disk, after an interruption."""

from __future__ import annotations

import multiprocessing
import warnings
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import numpy as np
import pytest
from ensemble_scenes import pushed, swinging
from scenes import double_pendulum, henon_heiles

import varint as vi
from varint.ensembles import executor as module
from varint.ensembles.chunk import ARRAYS
from varint.numerics.archive import read_archive, write_archive

TIMES = np.linspace(0, 8, 17)


@pytest.fixture
def small_chunks(monkeypatch):
    """Chunks of a few members, so that there are many."""
    monkeypatch.setattr(module, "SECONDS", 1e-9)


def stars(count: int) -> dict:
    """Starts in Hénon and Heiles' potential, from some of which they leave for infinity."""
    rng = np.random.default_rng(5)
    return dict(q0=rng.normal(size=(count, 2)) / 4, v0=rng.normal(size=(count, 2)) / 4)


def assert_same(one: vi.Ensemble, other: vi.Ensemble) -> None:
    for name in ("q", "p", "t", "good", "failed", "steps", "error_estimate"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name
    assert [str(error) for error in one.errors.values()] == [
        str(error) for error in other.errors.values()
    ]


def test_threads_and_processes_give_the_bits_of_one_process(small_chunks):
    system, start = henon_heiles(), stars(60)
    plain = vi.ensemble(system, at=TIMES, **start)
    assert 0 < len(plain.failed) < 30
    with ThreadPoolExecutor(3) as pool:
        assert_same(vi.ensemble(system, at=TIMES, executor=pool, **start), plain)
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:
        there = vi.ensemble(system, at=TIMES, executor=pool, **start)
        table = dict(q0=[0, 0.5], v0=[0, 0], u=np.arange(160.0).reshape(40, 4, 1) % 7, duration=1.0)
        given = vi.ensemble(pushed(), vi.gauss(2), executor=pool, **table)
    assert_same(there, plain)
    assert len(there.chunks) > 4 and given.rule == vi.gauss(2)
    assert_same(given, vi.ensemble(pushed(), vi.gauss(2), **table))


def test_neither_the_order_of_the_members_nor_chunks_show(monkeypatch):
    system, start = henon_heiles(), stars(50)
    plain = vi.ensemble(system, at=TIMES, **start)
    mixed = np.random.default_rng(0).permutation(50)
    monkeypatch.setattr(module, "SECONDS", 1e-9)
    other = vi.ensemble(system, at=TIMES, q0=start["q0"][mixed], v0=start["v0"][mixed])
    assert len(other.chunks) > len(plain.chunks)
    assert other.q.data.tobytes() == plain.q.data[mixed].tobytes()


def test_warnings_of_workers_come_once_with_the_numbers_of_their_members(small_chunks):
    q0 = np.full((40, 2), 0.01)
    q0[[11, 27, 38]] = [[2.0, 2.5], [2.0, 2.6], [2.1, 2.5]]
    start = dict(q0=q0, v0=[0, 0], duration=25.0)
    filters = list(warnings.filters)
    for pool in (
        ThreadPoolExecutor(3),
        ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")),
    ):
        with pool, pytest.warns(UserWarning, match=r"^3 members, \[11, 27, 38\]; of") as heard:
            vi.ensemble(double_pendulum(), executor=pool, **start)
        assert len(heard) == 1
    assert warnings.filters == filters


@pytest.mark.parametrize("kind", ["kept", "kept.zarr"])
def test_a_store_goes_on_after_an_interruption_and_is_loaded(
    kind, small_chunks, tmp_path, monkeypatch
):
    if kind.endswith("zarr"):
        pytest.importorskip("zarr", reason="needs the extra: pip install varint-mechanics[zarr]")
    system, start, where = henon_heiles(), stars(53), tmp_path / kind
    plain = vi.ensemble(system, at=TIMES, tol=1e-6, **start)
    stepped, done = module.step_chunk, []

    def counted(*arguments):
        if len(done) == 4:
            raise KeyboardInterrupt
        done.append(arguments[2].first)
        return stepped(*arguments)

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(module, "step_chunk", counted)
        vi.ensemble(system, at=TIMES, tol=1e-6, store=where, **start)
    with pytest.raises(vi.InputError, match="not complete"):
        vi.load(where)
    before, done[:] = list(done), []
    monkeypatch.setattr(
        module, "step_chunk", lambda *given: (done.append(given[2].first), stepped(*given))[1]
    )
    again = vi.ensemble(system, at=TIMES, tol=1e-6, store=where, **start)
    assert done and not set(done) & set(before)
    assert_same(again, plain)
    loaded = vi.load(where)
    assert_same(loaded, plain)
    assert repr(loaded) == repr(plain) and loaded.rule is None
    for i in (0, int(plain.failed[0]), 52):
        assert loaded[i].q.tobytes() == plain[i].q.tobytes()
    np.testing.assert_array_equal(loaded.mean(system.q[0]), plain.mean(system.q[0]))
    for name, other in (
        ("tol", dict(at=TIMES, tol=1e-7)),
        ("times", dict(at=TIMES + np.append(np.zeros(15), [0.1, 0]), tol=1e-6)),
        ("duration", dict(at=TIMES, duration=9.0, tol=1e-6)),
    ):
        with pytest.raises(vi.InputError, match=f"another ensemble: it differs in .*'{name}'"):
            vi.ensemble(system, store=where, **other, **start)
    with pytest.raises(vi.InputError, match="another ensemble: it differs in"):
        vi.ensemble(system, h=0.5, steps=16, store=where, **start)


def test_stores_with_a_rule_and_controls_are_loaded(tmp_path):
    words = dict(q0=[0, 0.5], v0=[0, 0], u=np.arange(20.0).reshape(5, 4, 1) % 7, duration=1.0)
    kept = vi.ensemble(pushed(), vi.gauss(2), store=tmp_path / "kept", **words)
    loaded = vi.load(tmp_path / "kept")
    assert_same(loaded, kept)
    assert (
        loaded.rule == vi.gauss(2)
        and loaded[3].at(0.37).q.tobytes() == kept[3].at(0.37).q.tobytes()
    )


@pytest.mark.parametrize("kind", ["kept", "kept.zarr"])
def test_stores_of_earlier_versions_are_loaded_and_gone_on_with(kind, tmp_path):
    """They had no estimates of errors."""
    start = dict(q0=np.linspace(0.1, 2, 30), v0=0.0, h=0.1, steps=20)
    where = tmp_path / kind
    if kind.endswith("zarr"):
        zarr = pytest.importorskip(
            "zarr", reason="needs the extra: pip install varint-mechanics[zarr]"
        )
        plain = vi.ensemble(swinging(), store=where, **start)
        group = zarr.open_group(str(where), mode="a")
        del group["estimate"]
        group["good"][20:] = 0  # the last ones are missing
    else:
        plain = vi.ensemble(swinging(), store=where, **start)
        chunks = sorted(where.glob("members_*"))
        for path in chunks:
            header, arrays = read_archive(path, "a chunk")
            del arrays["estimate"]
            assert set(arrays) == set(ARRAYS) - {"estimate"}
            with path.open("wb") as file:
                write_archive(file, header, arrays, compress=False)
        chunks[-1].unlink()
    with pytest.raises(vi.InputError, match="not complete"):
        vi.load(where)
    again = vi.ensemble(swinging(), store=where, **start)
    assert_same(again, vi.ensemble(swinging(), **start))
    assert_same(vi.load(where), plain)


@pytest.mark.parametrize("wrong", ["tol", "backend", "duration", "times"])
def test_torn_headers_are_refused(wrong, tmp_path):
    vi.ensemble(swinging(), q0=[0.1, 0.2], v0=0.0, duration=1.0, store=tmp_path / "kept")
    path = tmp_path / "kept" / "ensemble.npz"
    header, arrays = read_archive(path, "an ensemble")
    if wrong == "times":
        arrays["times"] = arrays["times"][None]
    else:
        header[wrong] = [1]
    with path.open("wb") as file:
        write_archive(file, header, arrays, compress=False)
    with pytest.raises(vi.InputError, match=f"is no whole ensemble: .*{wrong}"):
        vi.load(tmp_path / "kept")


def test_ctrl_c_within_a_member_ends_the_ensemble(monkeypatch):
    from varint.ensembles import chosen

    monkeypatch.setattr(chosen, "short_call", lambda *_: None)
    made = chosen.simulate

    def stopped(*arguments, **words):
        motion = made(*arguments, **words)
        return chosen.with_stats(motion, interrupted=True)

    monkeypatch.setattr(chosen, "simulate", stopped)
    with pytest.raises(KeyboardInterrupt):
        vi.ensemble(swinging(), q0=[0.1, 0.2], v0=0.0, duration=1.0)
