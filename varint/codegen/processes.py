"""Compilers as processes: each in a group of its own that ends as one, at the latest with the
process that started it, however that ends.
"""

from __future__ import annotations

import os
import signal
import subprocess
import weakref
from contextlib import suppress
from pathlib import Path

# $0: the folder of its results. What reads the pipe comes to the pipe's end when the process that
# holds the other one is gone, killed without a chance to clean up included.
GUARDED = """
exec 3<&0
"$@" </dev/null 3<&- & work=$!
{ trap '' TERM; read gone; kill -TERM -$$; rm -rf "$0"; } <&3 >/dev/null 2>&1 & guard=$!
exec 3<&-
wait $work; code=$?
kill -KILL $guard
exit $code
"""


def start(line: list[str], place: Path, output: int = subprocess.DEVNULL) -> subprocess.Popen:
    """A program and go on; what it writes besides its result lies in the folder, too.

    Program and folder go where this process is killed before the program has ended.
    """
    alive, held = os.pipe()
    try:
        process = subprocess.Popen(
            ["/bin/sh", "-c", GUARDED, str(place), *line] if os.name == "posix" else line,
            stdin=alive,
            stdout=output,
            stderr=output,
            text=True,
            errors="replace",
            env=os.environ | dict.fromkeys(("TMPDIR", "TMP", "TEMP"), str(place)),
            start_new_session=True,
        )
    except BaseException:
        os.close(held)
        raise
    finally:
        os.close(alive)
    weakref.finalize(process, os.close, held)
    return process


def end(process: subprocess.Popen) -> None:
    """End a program and all that it has started."""
    with suppress(OSError):  # it has just ended
        if hasattr(os, "killpg"):
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()
    process.wait()


def run(line: list[str], place: Path, seconds: float) -> tuple[int, str]:
    """What a program returns, and its complaints; whatever ends the wait for it ends it."""
    with start(line, place, subprocess.PIPE) as process:
        try:
            _, said = process.communicate(timeout=seconds)
        except BaseException:
            end(process)
            raise
    return process.returncode, said
