"""Compiles C source to a shared object once and keeps it in the user's cache folder.

A file is keyed by its source, the compiler, the flags and the processor; it is written under a temporary name and
moved into place, so that processes running at the same time are safe. Nothing is loaded that others could have written.
"""

from __future__ import annotations

import ctypes
import hashlib
import importlib.util
import os
import platform
import shutil
import stat
import subprocess
import sys
import tempfile
from functools import lru_cache
from pathlib import Path

from varint.errors import VarintError

FLAGS = ("-O3", "-march=native", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast")
SHARED = ("-std=gnu11", "-shared", "-fPIC", "-w")
LIBRARIES = (("-lmvec", "-lm"), ("-DNO_LIBMVEC", "-lm"))  # with the C library's vector functions, or without
SLOWEST_COMPILATION = 600  # seconds


class CompileError(VarintError, RuntimeError):
    """No C compiler, or it refused, or the cache folder is not safe; the interpreted backend needs none of them."""


@lru_cache(maxsize=1)
def compiler() -> tuple[str, ...] | None:
    """The command of a C compiler: $CC, cc, gcc, clang, or the wheel of the `jit` extra; None where there is none."""
    named = os.environ.get("CC", "").split()
    for command in ([named] if named else []) + [["cc"], ["gcc"], ["clang"]]:
        found = shutil.which(command[0])
        if found:
            return (found, *command[1:])
    if importlib.util.find_spec("ziglang"):
        return (sys.executable, "-m", "ziglang", "cc")
    return None


@lru_cache(maxsize=1)
def machine() -> str:
    """What decides the machine code: compiler, processor, flags. No subprocess is started for it."""
    command = compiler()
    if command is None:
        raise CompileError(
            "no C compiler was found (cc, gcc, clang); install one, or `pip install varint-mechanics[jit]`, or use "
            'backend="interpreted"'
        )
    program = os.path.realpath(command[0])
    about = os.stat(program)
    return "\n".join([*command, program, str(about.st_size), str(about.st_mtime_ns), _processor(), *FLAGS, *SHARED])


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().split("\n\n")[0].splitlines()
    except OSError:
        return f"{platform.machine()} {platform.processor()} {platform.platform()}"
    wanted = ("model name", "flags", "Features")
    return platform.machine() + "".join(x for x in lines if x.split(":")[0].strip() in wanted)


def vector_length() -> int:
    """Doubles in a vector register of this machine: 8, 4 or 2."""
    names = _processor().split()
    return 8 if "avx512f" in names else 4 if "avx2" in names else 2


def cache_folder() -> Path:
    """The user's own folder for compiled code; made with mode 0700, refused when others could write to it."""
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    folder = root / "varint"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise CompileError(f"the cache folder {folder} cannot be made ({error.strerror}); set XDG_CACHE_HOME") from None
    _refuse_foreign(folder)
    return folder


def _refuse_foreign(path: Path) -> None:
    if not hasattr(os, "geteuid"):
        return
    about = path.lstat()
    if stat.S_ISLNK(about.st_mode) or about.st_uid != os.geteuid() or about.st_mode & 0o022:
        raise CompileError(
            f"{path} is a link, belongs to another user or is writable by others, so compiled code in it is not "
            "trusted; remove it or set XDG_CACHE_HOME to a folder of your own"
        )


@lru_cache(maxsize=512)
def library(source: str) -> ctypes.CDLL:
    """The compiled source, from memory, from the cache folder, or compiled now."""
    key = hashlib.sha256(f"{machine()}\n{source}".encode()).hexdigest()[:40]
    folder = cache_folder()
    for path in folder.glob(f"{key}-*.so"):
        _refuse_foreign(path)
        if path.name == f"{key}-{path.stat().st_size}.so":  # else it was cut short, for example by a full disk
            return ctypes.CDLL(str(path))
        path.unlink(missing_ok=True)
    return ctypes.CDLL(str(_compiled(source, folder, key)))


def _compiled(source: str, folder: Path, key: str) -> Path:
    command = compiler()
    assert command is not None
    with tempfile.TemporaryDirectory(dir=folder, prefix="build-") as place:
        text, result = Path(place) / "kernel.c", Path(place) / "kernel.so"
        text.write_text(source)
        for libraries in LIBRARIES:
            line = [*command, *FLAGS, *SHARED, str(text), "-o", str(result), *libraries]
            try:
                done = subprocess.run(line, capture_output=True, text=True, timeout=SLOWEST_COMPILATION)
            except (OSError, subprocess.TimeoutExpired) as error:
                raise CompileError(f"the C compiler {command[0]} could not be run: {error}") from None
            if done.returncode == 0 and _loads(result):
                result.chmod(0o700)
                path = folder / f"{key}-{result.stat().st_size}.so"
                os.replace(result, path)
                return path
    errors = "\n".join(x for x in done.stderr.splitlines() if "error" in x)[:500]
    raise CompileError(
        f'the C compiler {" ".join(command)} refused the generated code; use backend="interpreted"\n{errors}'
    )


def _loads(path: Path) -> bool:
    try:
        ctypes.CDLL(str(path))
    except OSError:
        return False
    return True
