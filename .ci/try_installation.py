"""Try an installed varint without its repository: the README's six lines, a model with its picture
from the command line, and a notebook where Jupyter's client is installed.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

SIX_LINES = """
import casadi as ca
import varint as vi

q, v = vi.coordinates("theta")
pendulum = vi.System(q, v, v**2 / 2 + 9.81 * ca.cos(q))
motion = vi.simulate(pendulum, q0=1.0, v0=0.0, duration=10.0)
motion.plot().savefig("pendulum.png")
assert abs(motion.energy - motion.energy[0]).max() < 1e-9
assert vi.course.check("6.1", 4.0)
print(vi.__version__, vi.__file__, motion)
"""


COMPILED = """
import ctypes
import os
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.metadata import distribution
from pathlib import Path

import varint

folder = Path(varint.__file__).parent
parts = [path for end in EXTENSION_SUFFIXES[:1] for path in folder.rglob(f"*{end}")]
for path in parts:
    ctypes.CDLL(str(path), mode=getattr(os, "RTLD_NOW", 0))  # every function that it needs is there
pure = "Root-Is-Purelib: true" in (distribution("varint-mechanics").read_text("WHEEL") or "")
assert pure != bool(parts), f"a wheel for one platform must have compiled parts: {parts}"
print("compiled parts:", [path.name for path in parts])
"""


def main() -> None:
    """Everything in an empty folder, in processes that see no other varint."""
    hidden = ("PYTHONPATH", "PYTHONHOME")
    environment = {name: x for name, x in os.environ.items() if name not in hidden}
    environment["MPLBACKEND"] = "Agg"

    with tempfile.TemporaryDirectory() as folder:

        def run(*command: str) -> None:
            subprocess.run([sys.executable, *command], check=True, cwd=folder, env=environment)

        def require(name: str) -> None:
            if (Path(folder) / name).stat().st_size < 5000:
                raise SystemExit(f"{name} is no picture")

        run("-c", COMPILED)
        run("-W", "error", "-c", SIX_LINES)
        require("pendulum.png")
        run("-W", "error", "-m", "varint", "run", "double_pendulum", "--plot", "double.png")
        require("double.png")
        if find_spec("nbclient") and find_spec("ipykernel"):
            del environment["MPLBACKEND"]  # notebooks have their own
            run("-c", NOTEBOOK)
        else:
            print("no notebook: nbclient or ipykernel is not installed")


NOTEBOOK = f"""
import nbformat
from nbclient import NotebookClient

cells = [
    nbformat.v4.new_code_cell({SIX_LINES!r}),
    nbformat.v4.new_code_cell("motion"),
    nbformat.v4.new_code_cell(
        "model = vi.models.double_pendulum()\\n"
        "swing = vi.simulate(model.system, q0=model.q0, v0=model.v0, duration=1.0)\\n"
        "swing.animate(sketch=vi.models.sketch(model), fps=5)"
    ),
]
done = NotebookClient(nbformat.v4.new_notebook(cells=cells), timeout=120).execute()
shown = [out.data["text/html"] for out in done.cells[1].outputs + done.cells[2].outputs]
assert "Trajectory" in shown[0] and "image/gif" in shown[1], shown
print("a notebook ran, its film inside")
"""

if __name__ == "__main__":
    main()
