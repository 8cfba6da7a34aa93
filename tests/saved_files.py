"""Files that `save` wrote, taken apart and put together with other contents."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import numpy as np
from scenes import henon_heiles

import varint as vi


def parts_of(path: Path) -> tuple[dict, dict[str, np.ndarray]]:
    """The header and the arrays of a file."""
    with np.load(path) as data:
        arrays = {name: data[name] for name in data.files if name != "header"}
        return json.loads(str(data["header"])), arrays


def put(path: Path, header, arrays) -> Path:
    """A file of this header, a text or what it says, and these arrays."""
    text = header if isinstance(header, str) else json.dumps(header)
    with path.open("wb") as file:
        np.savez(file, header=np.array(text), **arrays)
    return path


def saved(folder: Path, motion: vi.Trajectory) -> Path:
    motion.save(folder / "whole.npz")
    return folder / "whole.npz"


def plain_run(**more) -> vi.Trajectory:
    start = dict(q0=[0.1, 0.2], v0=[0, 0.1], h=0.1, steps=5)
    return vi.simulate(henon_heiles(), **start | more)


def npy(shape: str, dtype: str = "<f8", data: bytes = b"", version: bytes = b"\x01\x00") -> bytes:
    """An array as NumPy writes it, whatever shape and type it says it has."""
    text = f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    length = len(text).to_bytes(2 if version == b"\x01\x00" else 4, "little")
    return b"\x93NUMPY" + version + length + text + data


def zipped(path: Path, members: dict[str, bytes], **kind) -> Path:
    """An archive of these members."""
    with zipfile.ZipFile(path, "w", **kind) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return path


def whole_members(tmp_path: Path) -> dict[str, bytes]:
    """The members of a file in which nothing is wrong."""
    with zipfile.ZipFile(saved(tmp_path, plain_run())) as archive:
        return {name: archive.read(name) for name in archive.namelist()}
