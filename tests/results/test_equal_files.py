"""What is written comes back bit for bit, and equal contents are equal bytes."""

from __future__ import annotations

import io

import numpy as np
from saved_files import parts_of, plain_run, saved

import varint as vi
from varint.numerics.archive import read_archive


def test_equal_contents_are_equal_files(tmp_path):
    motion = plain_run()
    motion.save(tmp_path / "a.npz")
    vi.load(tmp_path / "a.npz").save(tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_what_varint_writes_numpy_reads_without_pickle(tmp_path):
    header, arrays = parts_of(saved(tmp_path, plain_run()))
    assert header["format"] == "varint trajectory 2" and arrays["q"].shape == (6, 2)
    found = read_archive(tmp_path / "whole.npz", "trajectory")[1]
    for name, x in arrays.items():
        assert found[name].dtype == x.dtype and found[name].tobytes() == x.tobytes()


def test_arrays_in_any_order_of_memory_and_of_no_size_come_back(tmp_path):
    from varint.numerics.archive import write_archive

    arrays = {
        "a": np.asfortranarray(np.arange(6.0).reshape(2, 3)),
        "b": np.zeros((3, 0)),
        "c": np.float64(2.5),
        "d": np.arange(4).reshape(2, 2).T,
        "e": np.array([1.0, -0.0, np.nan, np.inf]).astype(">f8"),
        "f": np.array([True, False]),
    }
    for compress in (True, False):
        file = io.BytesIO()
        write_archive(file, {"é": "∂L/∂v"}, arrays, compress=compress)
        (tmp_path / "a.npz").write_bytes(file.getvalue())
        header, found = read_archive(tmp_path / "a.npz", "archive")
        assert header == {"é": "∂L/∂v"}
        for name, x in arrays.items():
            np.testing.assert_array_equal(found[name], x)
            assert found[name].dtype.isnative and found[name].shape == np.shape(x)


def test_states_between_nodes_come_back_bit_for_bit_whatever_found_them(tmp_path):
    ball = vi.models.slide_off_sphere()
    times = np.linspace(0.0, -0.38, 40)
    for backend in ("auto", "interpreted"):
        start = dict(q0=ball.q0, v0=ball.v0, h=-0.01, steps=38, backend=backend)
        motion = vi.simulate(ball.system, **start)
        motion.save(tmp_path / "motion.npz")
        there, again = motion.at(times), vi.load(tmp_path / "motion.npz").at(times)
        assert there.q.tobytes() == again.q.tobytes() and there.p.tobytes() == again.p.tobytes()
