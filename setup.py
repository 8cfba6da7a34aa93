"""Builds the loops for scenes as data (varint/codegen/c/*core.c) where there is a C compiler, and
where Python has its headers what calls them at once (direct.c).

All else stands in pyproject.toml. Without a compiler the package is installed all the same: runs
are then interpreted, ten to a hundred times slower. VARINT_LEVELS="plain x86-64-v3 x86-64-v4"
builds for several generations of processors, as wheels for others need; by default for the one at
hand.
"""

import hashlib
import os
import platform
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

FOLDER = Path("varint/codegen/c")
CORE = "varint.codegen._core"
FLAGS = ["-O2", "-std=gnu11", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=off", "-w"]
NAMES = (
    "",
    "dense_",
    "sweep_gauss_",
    "newton_",
    "explicit_",
    "contacts_",
    "uniform_",
    "driven_",
    "sweep_",
    "sweep_explicit_",
    "sweep_linear_",
    "rows_",
    "two_runs_",
    "varying_",
    "refined_",
    "few_steps_",
    "held_",
    "times_",
    "until_",
    "nearness_",
    "look_ahead_",
    "crossings_",
    "switches_",
    "tape_",
    "algebra_",
    "dependence_",
)  # the first three for every shape
# numbers in a vector: those of a register, and shorter ones for few stages; vectors up to 8 or 12
# stages, and for 16, by which motions are looked at within steps
SHAPES = {
    "x86-64-v4": [(8, 1), (8, 2), (4, 1), (2, 1), (1, 1)],
    "x86-64-v3": [(4, 1), (4, 2), (4, 3), (4, 4), (2, 1), (1, 1)],
    "plain": [(2, 1), (2, 2), (2, 3), (2, 4), (2, 8), (1, 1)],
}


def digest() -> str:
    """Of the C sources; varint/codegen/core.py compares it."""
    found = hashlib.sha256()
    for path in sorted(FOLDER.glob("*.[ch]")):
        found.update(path.read_bytes())
    return found.hexdigest()


def levels() -> list[str]:
    if platform.machine() not in ("x86_64", "AMD64") or sys.platform == "win32":
        return ["plain"]
    named = os.environ.get("VARINT_LEVELS")
    if named:
        return [level if level in SHAPES else "plain" for level in named.split()]
    try:
        flags = Path("/proc/cpuinfo").read_text().split()
    except OSError:
        return ["plain"]
    return ["x86-64-v4" if "avx512f" in flags else "x86-64-v3" if "avx2" in flags else "plain"]


class BuildCore(build_ext):
    def build_extension(self, ext):
        if ext.name != CORE:
            return super().build_extension(ext)

        def compiled(variant):
            source, level, numbers = variant
            macros = [("LEVEL", level.replace("-", "_"))]
            if variant == described:
                macros.append(("DIGEST", f'"{digest()}"'))
            macros += zip(("LANES", "VECTORS", "FORM"), map(str, numbers), strict=False)
            flags = FLAGS + ([] if level == "plain" else [f"-march={level}"])
            folder = "-".join(["build", level, *map(str, numbers)])
            return self.compiler.compile(
                [source],
                output_dir=str(Path(self.build_temp) / folder),
                macros=macros,
                extra_preargs=flags,
                depends=ext.depends,
            )

        gauss, dense, sweep, *others = ext.sources
        variants = [(source, level, ()) for source in others for level in levels()]
        for level in levels():
            variants += [(gauss, level, (*x, form)) for x in SHAPES[level] for form in (1, 2)]
            variants += [(source, level, x) for source in (dense, sweep) for x in SHAPES[level]]
        described = next(x for x in variants if x[2][:1] > (1,))  # by the functions of its vectors
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            objects = [path for paths in pool.map(compiled, variants) for path in paths]
        libraries = ["mvec", "m"] if sys.platform == "linux" and "x86" in platform.machine() else []
        self.compiler.link_shared_object(
            objects, self.get_ext_fullpath(ext.name), libraries=libraries
        )


setup(
    ext_modules=[
        Extension(
            CORE,
            [str(FOLDER / f"{name}core.c") for name in NAMES],
            depends=sorted(str(path) for path in FOLDER.glob("*.[ch]")),
            optional=True,  # a failure becomes a warning
        ),
        Extension(
            "varint.codegen._direct",
            [str(FOLDER / "direct.c")],
            depends=sorted(str(path) for path in FOLDER.glob("*.[ch]")),
            define_macros=[("DIGEST", f'"{digest()}"')],
            extra_compile_args=["-w"],  # of a header it takes a part
            optional=True,  # calls take some microseconds more
        ),
    ],
    cmdclass={"build_ext": BuildCore},
)
