"""Whole scripts: a process from its start to its end, as a user waits for it, varint's default call
beside heyoka's.

python benchmarks/scripts.py [scene ...]     needs `pip install varint-mechanics[bench]`

Each script imports the package, writes the scene down as a Lagrangian, runs it for the time and the
tolerance wanted and prints where it ends. It is run with nothing cached; then, as users do, with
another value of its parameter; then with a third one, by when all that can be kept is kept. Tools
take turns; all are there as byte code, as they are once installed. Errors are those of the end,
relative to the largest coordinate, against heyoka's run at 1e-17; ratios are what to look at.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from time import perf_counter

import numpy as np
from tools.byte_code import make_byte_code
from tools.record import save, table

ROOT = Path(__file__).parent.parent
TURNS = 3
TIMES = ("first", "another value", "later")
VARINT = """
import casadi as ca
import varint as vi
{varint}
c = vi.Parameters({name}={value})
system = vi.System(q, v, {lagrangian}, params=c)
motion = vi.simulate(system, q0={q0}, v0={v0}, duration={duration}, tol={tol})
print(*motion.q[-1].tolist())
"""
HEYOKA = """
import heyoka as hy
{heyoka}
class c:
    {name} = hy.par[0]
rates = hy.lagrangian({lagrangian}, q, v)
run = hy.taylor_adaptive(rates, [*{q0}, *{v0}], tol={tol}, pars=[{value}])
run.propagate_until({duration})
print(*run.state[: len(q)].tolist())
"""


@dataclass(frozen=True)
class Script:
    """A scene in words that both tools understand: coordinates q, velocities v, parameter c."""

    names: tuple[str, ...]
    lagrangian: str
    parameter: tuple[str, tuple[float, ...]]
    q0: tuple[float, ...]
    v0: tuple[float, ...]
    duration: float
    tol: float

    def text(self, tool: str, value: float, tol: float) -> str:
        names = ", ".join(f'"{x}"' for x in self.names)
        speeds = ", ".join(f'"{x}_dot"' for x in self.names)
        heads = {
            "varint": f"q, v = vi.coordinates({names})\nfrom casadi import cos, sin, sqrt",
            "heyoka": f"q, v = hy.make_vars({names}), hy.make_vars({speeds})\n"
            "q, v = ([x] if isinstance(x, hy.expression) else list(x) for x in (q, v))\n"
            "from heyoka import cos, sin, sqrt",
        }
        words = {
            "name": self.parameter[0],
            "value": value,
            "lagrangian": self.lagrangian,
            "q0": list(self.q0),
            "v0": list(self.v0),
            "duration": self.duration,
            "tol": tol,
        }
        return (VARINT if tool == "varint" else HEYOKA).format(**heads, **words)


def spring(duration: float) -> Script:
    """A mass on a spring in polar coordinates."""
    lagrangian = (
        "(v[0]**2 + q[0]**2 * v[1]**2) / 2 + c.g * q[0] * cos(q[1]) - 20.0 * (q[0] - 1.0)**2"
    )
    start = (1.2, 0.4), (0.0, 0.0)
    return Script(("r", "theta"), lagrangian, ("g", (9.81, 9.8, 3.7)), *start, duration, 1e-9)


def arenstorf() -> Script:
    """A periodic orbit of the restricted three-body problem in the rotating frame (Hairer, Nørsett
    & Wanner, Solving ODEs I, §II.0); mu is the smaller mass.
    """
    lagrangian = (
        "((v[0] - q[1])**2 + (v[1] + q[0])**2) / 2"
        " + (1 - c.mu) / sqrt((q[0] + c.mu)**2 + q[1]**2)"
        " + c.mu / sqrt((q[0] - 1 + c.mu)**2 + q[1]**2)"
    )
    mu = 0.012277471
    start = (0.994, 0.0), (0.0, -2.00158510637908252240537862224)
    values = "mu", (mu, mu * (1 + 1e-9), mu * (1 - 1e-9))
    return Script(("x", "y"), lagrangian, values, *start, 17.0652165601579625588917206249, 1e-6)


def pleiades() -> Script:
    """Seven bodies in the plane (Hairer, Nørsett & Wanner, §II.10), masses 1 to 7."""
    kinetic = " + ".join(f"{i + 1}.0 * (v[{2 * i}]**2 + v[{2 * i + 1}]**2) / 2" for i in range(7))
    pull = " + ".join(
        f"c.G * {(i + 1) * (j + 1)}.0 / sqrt((q[{2 * i}] - q[{2 * j}])**2"
        f" + (q[{2 * i + 1}] - q[{2 * j + 1}])**2)"
        for i in range(7)
        for j in range(i)
    )
    x, y = (3, 3, -1, -3, 2, -2, 2), (3, -3, 2, 0, 0, -4, 4)
    x_dot, y_dot = (0, 0, 0, 0, 0, 1.75, -1.5), (0, 0, 0, -1.25, 1, 0, 0)
    q0 = tuple(float(a) for pair in zip(x, y, strict=True) for a in pair)
    v0 = tuple(float(a) for pair in zip(x_dot, y_dot, strict=True) for a in pair)
    names = tuple(f"{a}{i}" for i in range(7) for a in "xy")
    values = "G", (1.0, 1.0 + 1e-9, 1.0 - 1e-9)
    return Script(names, f"{kinetic} + {pull}", values, q0, v0, 3.0, 1e-6)


def kepler() -> Script:
    lagrangian = "(v[0]**2 + v[1]**2) / 2 + c.mu / sqrt(q[0]**2 + q[1]**2)"
    values = "mu", (1.0, 1.001, 0.999)
    return Script(("x", "y"), lagrangian, values, (0.4, 0.0), (0.0, 2.0), 200 * np.pi, 1e-9)


def henon_heiles() -> Script:
    lagrangian = (
        "(v[0]**2 + v[1]**2 - q[0]**2 - q[1]**2) / 2 - c.k * (q[0]**2 * q[1] - q[1]**3 / 3)"
    )
    values = "k", (1.0, 0.99, 0.98)
    return Script(("x", "y"), lagrangian, values, (0.0, 0.1), (0.4, 0.0), 1000.0, 1e-9)


SCENES = {
    "spring pendulum, T = 60": lambda: spring(60.0),
    "spring pendulum, T = 6000": lambda: spring(6000.0),
    "kepler, 100 orbits": kepler,
    "henon-heiles, T = 1000": henon_heiles,
    "restricted three bodies": arenstorf,
    "seven bodies": pleiades,
}


def process(text: str, cache: str) -> tuple[float, np.ndarray | None]:
    """Seconds of a script, and where it ends; None where it is refused."""
    environment = {**os.environ, "XDG_CACHE_HOME": cache}
    environment["PYTHONPATH"] = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    began = perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", text], env=environment, capture_output=True, text=True
    )
    took = perf_counter() - began
    if done.returncode:
        print(done.stderr.strip().splitlines()[-1][:200])
        return took, None
    return took, np.array(done.stdout.split(), dtype=float)


def measured(name: str, script: Script) -> list[dict]:
    """Seconds and errors of both tools, first and later."""
    values = script.parameter[1]
    with tempfile.TemporaryDirectory() as cache:
        exact = [process(script.text("heyoka", x, 1e-17), cache)[1] for x in values]
    times: dict[tuple[str, str], list[float]] = {}
    errors: dict[tuple[str, str], float | None] = {}
    for _ in range(TURNS):
        for tool in ("varint", "heyoka"):
            with tempfile.TemporaryDirectory() as cache:
                os.chmod(cache, 0o700)
                for when, value, end in zip(TIMES, values, exact, strict=True):
                    took, found = process(script.text(tool, value, script.tol), cache)
                    times.setdefault((tool, when), []).append(took)
                    error = None
                    if found is not None and end is not None:
                        error = float(np.abs(found - end).max() / np.abs(end).max())
                    errors[tool, when] = error
    rows = []
    for when in TIMES:
        varint, heyoka = (median(times[tool, when]) for tool in ("varint", "heyoka"))
        row = {"scene": name, "tol": script.tol, "run": when, "varint, s": varint}
        row |= {"heyoka, s": heyoka, "ratio": varint / heyoka}
        row |= {f"error, {tool}": errors[tool, when] for tool in ("varint", "heyoka")}
        rows.append(row)
    return rows


def main(names: list[str]) -> None:
    make_byte_code()
    rows = []
    for name in names or SCENES:
        rows += measured(name, SCENES[name]())
        table(rows[-len(TIMES) :])
    if not names:
        save("scripts", rows)


if __name__ == "__main__":
    main(sys.argv[1:])
