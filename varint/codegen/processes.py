"""Compilers as processes: each in a group of its own that ends as one."""

from __future__ import annotations

import os
import signal
import subprocess
from contextlib import suppress
from pathlib import Path


def start(line: list[str], place: Path, output: int = subprocess.DEVNULL) -> subprocess.Popen:
    """A program and go on; what it writes besides its result lies in the folder, too."""
    return subprocess.Popen(
        line,
        stdin=subprocess.DEVNULL,
        stdout=output,
        stderr=output,
        text=True,
        errors="replace",
        env=os.environ | dict.fromkeys(("TMPDIR", "TMP", "TEMP"), str(place)),
        start_new_session=True,
    )


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
