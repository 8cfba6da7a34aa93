"""Exported C, compiled and run."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

COMPILERS = [x for x in ("gcc", "clang") if shutil.which(x)]
STRICT = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic"]
needs_compiler = pytest.mark.skipif(not COMPILERS, reason="needs gcc or clang")


def compiled(
    folder: Path, *sources: str, compiler: str = "", options: tuple[str, ...] = ()
) -> Path:
    """The program of these sources, compiled without a warning."""
    line = [compiler or COMPILERS[0], *STRICT, *(options or ("-O0",)), *sources, "-o", "program"]
    made = subprocess.run([*line, "-lm"], cwd=folder, capture_output=True, text=True, check=False)
    assert made.returncode == 0, made.stderr
    return folder / "program"


def agreement(folder: Path, name: str, **given) -> tuple[int, float]:
    """What the test program returns, and the difference it prints."""
    program = compiled(folder, f"{name}.c", f"{name}_test.c", **given)
    done = subprocess.run([program], capture_output=True, text=True, check=False)
    words = done.stdout.split()
    return done.returncode, float(words[-1]) if done.returncode < 2 else np.nan
