"""Compiles C source to a shared object once and keeps it in the user's cache folder.

A file is named by its source, the compiler, the flags and the processor, and by a digest of its own
bytes; it is written under a temporary name, brought to the disk and moved into place, so that
processes running at the same time are safe. Nothing is loaded that others could have written, or
that a crash or a full disk has spoilt.
"""

from __future__ import annotations

import atexit
import ctypes
import hashlib
import os
import platform
import stat
import sys
import threading
from contextlib import suppress
from functools import lru_cache
from itertools import takewhile
from time import time
from typing import TYPE_CHECKING, NamedTuple

from varint.codegen.built import newer_functions
from varint.errors import VarintError

if TYPE_CHECKING:
    import subprocess
    from pathlib import Path

FLAGS = ("-O3", "-march=native", "-fno-math-errno", "-fno-trapping-math")
# products and sums are fused as the source says, or wherever the compiler finds them
AS_WRITTEN, WHEREVER = "-ffp-contract=off", "-ffp-contract=fast"
SHARED = ("-std=gnu11", "-shared", "-fPIC", "-w")
# with the C library's vector functions, or without; with the headers of the system where the
# compiler does not know the builtins of c/intrinsics.h
LIBRARIES = (
    ("-lmvec", "-lm"),
    ("-DNO_LIBMVEC", "-lm"),
    ("-DNO_LIBMVEC", "-DSYSTEM_HEADERS", "-lm"),
)
SLOWEST_COMPILATION = 600  # seconds
RESULT = "kernel.so"
PART = "part-"  # what names of unfinished files begin with
MOST_AT_WORK = 2  # compilers in the background
ABANDONED = 60  # seconds after which such a file belongs to nobody; writing one takes less than one


class CompileError(VarintError, RuntimeError):
    """No C compiler, or it refused, or the cache folder is not safe; the interpreted backend
    needs none of them.
    """


@lru_cache(maxsize=1)
def compiler() -> tuple[str, ...] | None:
    """The command of a C compiler: $CC, cc, gcc, clang, or the wheel of the `jit` extra; None
    where there is none.
    """
    from importlib.util import find_spec
    from shutil import which  # not all that is run is compiled

    named = os.environ.get("CC", "").split()
    for command in ([named] if named else []) + [["cc"], ["gcc"], ["clang"]]:
        found = which(command[0])
        if found:
            return (found, *command[1:])
    if find_spec("ziglang"):
        return (sys.executable, "-m", "ziglang", "cc")
    return None


@lru_cache(maxsize=1)
def machine() -> str:
    """What decides the machine code: compiler, processor, flags. No subprocess is started for
    it.
    """
    command = compiler()
    if command is None:
        raise CompileError(
            "no C compiler was found (cc, gcc, clang); install one, or `pip install "
            "varint-mechanics[jit]`, or use "
            'backend="interpreted"'
        )
    program = os.path.realpath(command[0])
    about = os.stat(program)
    return "\n".join(
        [
            *command,
            program,
            str(about.st_size),
            str(about.st_mtime_ns),
            _processor(),
            *FLAGS,
            *SHARED,
            *_functions(),
        ]
    )


def _functions() -> tuple[str, ...]:
    return () if newer_functions() else ("-DNO_NEWER_FUNCTIONS",)


@lru_cache(maxsize=1)
def _processor() -> str:
    wanted = ("model name", "flags", "Features")
    try:
        with open("/proc/cpuinfo") as file:  # the first processor: many take long to be written
            lines = [*takewhile(str.strip, file)]
    except OSError:
        return f"{platform.machine()} {platform.processor()} {platform.platform()}"
    found = (x.rstrip("\n") for x in lines if x.split(":")[0].strip() in wanted)
    return platform.machine() + "".join(found)


def vector_length() -> int:
    """Doubles in a vector register of this machine: 8, 4 or 2."""
    names = _processor().split()
    return 8 if "avx512f" in names else 4 if "avx2" in names else 2


@lru_cache(maxsize=1)
def has_instructions() -> bool:
    """Whether this machine has those that instructions.py writes, and calls functions as they
    do.
    """
    whole = sys.platform == "linux" and platform.machine() == "x86_64" and sys.maxsize > 1 << 32
    return whole and {"avx", "fma"} <= {*_processor().split()}


def cache_folder() -> Path:
    """The user's own folder for compiled code; made with mode 0700, refused when others could
    write to it.
    """
    from pathlib import Path  # takes longer to import than what is kept to read

    return Path(cache_place())


def cache_place() -> str:
    """`cache_folder` as text."""
    root = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    folder = os.path.join(root, "varint")
    try:
        os.makedirs(folder, mode=0o700, exist_ok=True)
    except OSError as error:
        raise CompileError(
            f"the cache folder {folder} cannot be made ({error.strerror}); set XDG_CACHE_HOME"
        ) from None
    refuse_foreign(folder)
    return folder


def refuse_foreign(path: str | Path) -> None:
    """Refuse what others could have written; raises OSError where there is nothing."""
    if not hasattr(os, "geteuid"):
        return
    about = os.lstat(path)
    if stat.S_ISLNK(about.st_mode) or about.st_uid != os.geteuid() or about.st_mode & 0o022:
        raise CompileError(
            f"{path} is a link, belongs to another user or is writable by others, so compiled code "
            "in it is not trusted; remove it or set XDG_CACHE_HOME to a folder of your own"
        )


@lru_cache(maxsize=512)
def library(source: str, contraction: str = WHEREVER) -> ctypes.CDLL:
    """The compiled source, from memory, from the cache folder, or compiled now.

    Parameters
    ----------
    source : str
    contraction : str
        `AS_WRITTEN` or `WHEREVER`.

    Raises
    ------
    CompileError
        If there is no compiler, or it refuses, or the cache folder is not safe or full.
    """
    folder, key = cache_folder(), _key(source, contraction)
    try:
        return _cached(folder, key) or _compile(source, folder, key, contraction)
    except OSError as error:
        raise _no_room(folder, error) from None


class Compilation(NamedTuple):
    """A compiler at work in a process of its own, and the folder it works in."""

    process: subprocess.Popen
    place: Path
    key: str


_AT_WORK: list[Compilation] = []
_ENDING = threading.Lock()  # one thread takes what a compiler has made


def in_cache(source: str, contraction: str = WHEREVER) -> bool:
    """Whether `library` need not start the compiler; raises CompileError as it does."""
    return _cached(cache_folder(), _key(source, contraction)) is not None


def begin_compilation(source: str, contraction: str = WHEREVER) -> Compilation | None:
    """Start the compiler and go on; `finished` says when `library` will have the result. None
    while `MOST_AT_WORK` others are on their way.

    It ends with this process at the latest. Raises CompileError as `library` does.
    """
    for work in [*_AT_WORK]:
        finished(work)
    if len(_AT_WORK) >= MOST_AT_WORK:
        return None
    # these take as long to import as all else of a first run in the low gear
    import tempfile
    from pathlib import Path

    from varint.codegen.processes import start

    folder, key = cache_folder(), _key(source, contraction)
    try:
        place = Path(tempfile.mkdtemp(prefix="varint-"))
        process = start(_command(place, source, contraction, LIBRARIES[0]), place)
    except OSError as error:
        raise _no_room(folder, error) from None
    work = Compilation(process, place, key)
    _AT_WORK.append(work)
    return work


def finished(work: Compilation) -> bool:
    """Whether the compiler has come to its end, whatever that is; what it made is kept."""
    with _ENDING:
        if work not in _AT_WORK:
            return True
        if work.process.poll() is None:
            return False
        if work.process.returncode == 0:
            with suppress(OSError, CompileError):  # no room: `library` will say so
                _store((work.place / RESULT).read_bytes(), cache_folder(), work.key)
        _AT_WORK.remove(work)
        _remove(work.place)
        return True


@atexit.register
def _end_work() -> None:
    while _AT_WORK:
        from varint.codegen.processes import end

        work = _AT_WORK.pop()
        end(work.process)
        _remove(work.place)


def _remove(folder: Path) -> None:
    import shutil

    shutil.rmtree(folder, ignore_errors=True)


def _key(source: str, contraction: str) -> str:
    return hashlib.sha256(f"{machine()}\n{contraction}\n{source}".encode()).hexdigest()[:40]


def _cached(folder: Path, key: str) -> ctypes.CDLL | None:
    for path in folder.glob(f"{key}-*.so"):
        refuse_foreign(path)
        if path.name == _file_name(key, path.read_bytes()):
            with suppress(OSError):  # made for another C library: compiled again
                return ctypes.CDLL(str(path))
        path.unlink(missing_ok=True)  # cut short or changed, for example by a full disk
    return None


def _no_room(folder: Path, error: OSError) -> CompileError:
    return CompileError(
        f"compiled code cannot be kept in {folder} ({error.strerror or error}); make room "
        "there or set XDG_CACHE_HOME"
    )


def _command(place: Path, source: str, contraction: str, libraries: tuple[str, ...]) -> list[str]:
    """The compiler's command line for a source that is written to a folder."""
    command = compiler()
    assert command is not None
    text = place / "kernel.c"
    text.write_text(source)
    return [
        *command,
        *FLAGS,
        *_functions(),
        contraction,
        *SHARED,
        str(text),
        "-o",
        str(place / RESULT),
        *libraries,
    ]


def _file_name(key: str, content: bytes) -> str:
    """The digest of a library is part of its name: bytes that are not its own are never loaded."""
    return f"{key}-{hashlib.sha256(content).hexdigest()[:24]}.so"


def _compile(source: str, folder: Path, key: str, contraction: str) -> ctypes.CDLL:
    """Compile outside the cache folder: what is interrupted leaves nothing in it."""
    import subprocess
    import tempfile
    from pathlib import Path

    from varint.codegen.processes import run

    command = compiler()
    assert command is not None
    with tempfile.TemporaryDirectory(prefix="varint-", ignore_cleanup_errors=True) as name:
        place = Path(name)
        for libraries in LIBRARIES:
            line = _command(place, source, contraction, libraries)
            try:
                code, said = run(line, place, SLOWEST_COMPILATION)
            except (OSError, subprocess.TimeoutExpired) as error:
                raise CompileError(
                    f"the C compiler {command[0]} could not be run: {error}"
                ) from None
            if code == 0:
                path = _store((place / RESULT).read_bytes(), folder, key)
                try:
                    return ctypes.CDLL(str(path))  # under its last name: it may not be renamed now
                except OSError as error:
                    path.unlink(missing_ok=True)
                    said += f"\nerror: {error}"
    errors = "\n".join(x for x in said.splitlines() if "error" in x)[:500]
    raise CompileError(
        f"the C compiler {' '.join(command)} refused the generated code; use "
        f'backend="interpreted"\n{errors}'
    )


def _store(content: bytes, folder: Path, key: str) -> Path:
    """Write under a name of one's own, bring it to the disk, rename: a crash leaves the whole
    file or none.
    """
    for old in folder.glob(f"{PART}*"):
        with suppress(FileNotFoundError):  # another process has just moved it into place
            if time() - old.stat().st_mtime > ABANDONED:
                old.unlink()
    import tempfile
    from pathlib import Path

    number, name = tempfile.mkstemp(dir=folder, prefix=PART)
    try:
        with os.fdopen(number, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(name, 0o700)
        path = folder / _file_name(key, content)
        os.replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
    return path
