"""All the set-up and all the runs: `python3 tasks.py demo`, `test`, `bench` or `docs`. Needs only
Python and pip.

A virtual environment `.venv` is made when there is none for this Python and this pyproject.toml;
nothing outside the project's folder is touched. Further arguments go to the tool: `python3 tasks.py
test -m long`.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import venv
from pathlib import Path

HERE = Path(__file__).resolve().parent
VENV = HERE / ".venv"
PYTHON = VENV / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
OLDEST = (3, 10)


def demo(*arguments: str) -> None:
    """Simulate the outer Solar System for 200,000 days; print drift, momenta, error; write
    picture and result.
    """
    prepare()
    run("examples/outer_solar_system.py", *arguments)


def test(*arguments: str) -> None:
    """Lint, format, types, then the tests (without those marked long)."""
    prepare("test")
    checks = (
        ["ruff", "check", "."],
        ["ruff", "format", "--check", "."],
        ["mypy"],
        ["pytest", "-n", "2", *arguments],
    )
    failed = [
        check[0] for check in checks if call("-m", *check)
    ]  # all of them: one complaint must not hide another
    if failed:
        sys.exit(f"failed: {', '.join(failed)}")


def bench(*arguments: str) -> None:
    """Measure run time against error, side by side with the peers: `bench [script [scene ...]]`."""
    prepare("test", "bench")
    if arguments:
        return run(*arguments)
    for script in sorted((HERE / "benchmarks").glob("*.py")):
        run(str(script.relative_to(HERE)))


def docs(*arguments: str) -> None:
    """Build the documentation into docs/_build/html; `docs -b linkcheck` tries every link,
    outside ones too.
    """
    prepare("docs")
    builder = arguments[arguments.index("-b") + 1] if "-b" in arguments[:-1] else "html"
    run(
        "-m",
        "sphinx",
        "-W",
        "--keep-going",
        "-q",
        "-j",
        "auto",
        "docs",
        f"docs/_build/{builder}",
        *arguments,
    )
    print(f"wrote docs/_build/{builder}" + ("/index.html" if builder == "html" else ""))


def prepare(*extras: str) -> None:
    """Make `.venv` and install the project with these extras, unless that has been done."""
    state = hashlib.sha256(
        (HERE / "pyproject.toml").read_bytes() + sys.version.encode()
    ).hexdigest()
    stamp = VENV / "installed.txt"
    done, *installed = stamp.read_text().split() if stamp.exists() else ["nothing"]
    if done == state and set(extras) <= set(installed):
        return
    if done != state:
        print("making .venv", flush=True)
        installed = []
        try:
            venv.create(VENV, with_pip=True, clear=True)
        except subprocess.CalledProcessError:
            sys.exit(
                "this Python cannot make an environment with pip; on Debian and Ubuntu: apt "
                "install python3-venv"
            )
    wanted = sorted({*installed, *extras})
    print(
        "installing varint into .venv" + (f" for {', '.join(wanted)}" if wanted else ""), flush=True
    )
    target = f".[{','.join(wanted)}]" if wanted else "."
    run("-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--editable", target)
    stamp.write_text(" ".join([state, *wanted]))


def run(*command: str) -> None:
    """Run a command of the environment's Python; its failure is ours."""
    code = call(*command)
    if code:
        sys.exit(code)


def call(*command: str) -> int:
    """The exit code of a command of the environment's Python in the project's folder, without a
    screen to draw on.
    """
    return subprocess.call(
        [str(PYTHON), *command], cwd=HERE, env={"MPLBACKEND": "Agg", **os.environ}
    )


TASKS = {task.__name__: task for task in (demo, test, bench, docs)}


def main(arguments: list[str]) -> None:
    if sys.version_info < OLDEST:
        sys.exit(
            f"varint needs Python {'.'.join(map(str, OLDEST))} or newer, this is "
            f"{sys.version.split()[0]}"
        )
    if not arguments or arguments[0] not in TASKS:
        lines = [f"  {name:6} {task.__doc__}" for name, task in TASKS.items()]
        sys.exit("\n".join(["usage: python3 tasks.py TASK [arguments]", *lines]))
    TASKS[arguments[0]](*arguments[1:])


if __name__ == "__main__":
    main(sys.argv[1:])
