"""C sources of the benchmarks as libraries: the compiler that varint takes, and its flags."""

from __future__ import annotations

import subprocess
import tempfile
from ctypes import CDLL
from pathlib import Path

from varint.codegen.cache import compiler

FLAGS = [
    "-O3",
    "-march=native",
    "-fno-math-errno",
    "-ffp-contract=fast",
    "-fopenmp-simd",
    "-shared",
    "-fPIC",
    "-w",
]
HERE = Path(__file__).parent


def library(text: str, file: str, folder: Path | None = None) -> CDLL:
    """`text` and the source `file` of this folder, compiled in `folder`, which `text` may include
    from.
    """
    folder = folder or Path(tempfile.mkdtemp(prefix="benchmark"))
    (folder / "run.c").write_text(text + (HERE / file).read_text())
    target = folder / "run.so"
    subprocess.run(
        [*compiler(), *FLAGS, str(folder / "run.c"), "-o", str(target), "-lm"], check=True
    )
    return CDLL(str(target))
