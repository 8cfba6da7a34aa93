"""The command line: `varint list | run | check | bench | play`, also as `python -m varint`."""

from __future__ import annotations

import argparse
import os
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import varint as vi
from varint.command_line.arguments import (
    chosen,
    file,
    positive,
    rule,
    setting,
    simulated,
    start_of,
)
from varint.explorer.page import serve
from varint.explorer.scene import scene_of_start
from varint.models import ControlModel, Model

# of all compositions those worth comparing first
EXPLICIT = (
    "verlet",
    "blanes-moan4",
    "blanes-moan6",
    "kahan-li8",
)
STEPS = (64, 128, 256, 512, 1024)
FIGURES, FILMS, DATA = (".png", ".pdf", ".svg"), (".gif", ".mp4", ".html"), (".npz",)
FILM = (2.0, 30.0)  # seconds that a film may last before its speed is changed, to 10 s


def say_once() -> Callable[..., None]:
    """Shows every warning as one line, the first time."""
    said: set[str] = set()

    def show(message: Warning | str, *_: object) -> None:
        if str(message) not in said:
            said.add(str(message))
            print(f"varint: {message}", file=sys.stderr)

    return show


def main(arguments: list[str] | None = None) -> int:
    """Run one command; warnings and errors become one line each, an error the exit code 2."""
    reader = parser()
    asked = reader.parse_args(arguments)
    if asked.command is None:
        reader.print_help()
        return 0
    with warnings.catch_warnings():
        warnings.simplefilter("always", UserWarning)
        warnings.showwarning = say_once()
        try:
            code = int(asked.command(asked) or 0)
            sys.stdout.flush()
            return code
        except BrokenPipeError:  # as by `list | head`: whoever read has seen enough
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 0
        except (vi.VarintError, OSError) as error:
            print(f"varint: {error}", file=sys.stderr)
            return 2


def parser() -> argparse.ArgumentParser:
    """All commands with their options."""
    top = argparse.ArgumentParser(
        prog="varint", description="Mechanics by the principle of least action."
    )
    top.add_argument("--version", action="version", version=f"varint {vi.__version__}")
    top.set_defaults(command=None)
    commands = top.add_subparsers(metavar="COMMAND")
    command = commands.add_parser("list", help="the ready models")
    command.set_defaults(command=list_models)
    for name, function, text in (
        ("run", run, "simulate a model, or solve one of optimal control"),
        ("check", check, "measure order, structure, energy, constraints and momenta on a model"),
        ("bench", bench, "run time against error of several rules on a model"),
        ("play", play, "a page with sliders for a model, in the browser"),
    ):
        command = commands.add_parser(name, help=text, description=f"{text[0].upper()}{text[1:]}.")
        command.set_defaults(command=function)
        command.add_argument("model", metavar="MODEL", help="its name, see `list`")
        command.add_argument(
            "--set",
            type=setting,
            action="append",
            metavar="NAME=VALUE",
            help="an argument of the model or a parameter of its scene, such as length=2 or m=1,2",
        )
        command.add_argument(
            "--start",
            type=setting,
            action="append",
            metavar="NAME=VALUE",
            help="a coordinate or velocity at the start, such as theta=1.2, theta_dot=0, q0=1,0",
        )
        command.add_argument(
            "--duration", type=positive, metavar="T", help="time span (default: the model's)"
        )
        if name != "bench":
            command.add_argument(
                "--rule", type=rule, help="such as gauss(2), lobatto(3), midpoint, blanes-moan6"
            )
            command.add_argument("--h", type=positive, help="step (default: the model's)")
        if name in ("run", "bench"):
            command.add_argument(
                "--plot",
                type=file(*FIGURES),
                metavar="FILE",
                help="write a figure (.png, .pdf, .svg)",
            )
        if name == "run":
            command.add_argument(
                "--animate",
                type=file(*FILMS),
                metavar="FILE",
                help="write an animation (.gif, .mp4, .html)",
            )
            command.add_argument(
                "--speed",
                type=positive,
                help="time of the motion per second of film (default: 1, or for a film of 10 s)",
            )
            command.add_argument(
                "--save", type=file(*DATA), metavar="FILE", help="write the trajectory (.npz)"
            )
        if name == "play":
            command.add_argument(
                "--port", type=int, default=0, help="of the page (default: any that is free)"
            )
            command.add_argument(
                "--no-browser", action="store_true", help="say where the page is, and open nothing"
            )
    return top


def list_models(asked: argparse.Namespace) -> None:
    """Names and claims."""
    for name, factory in (vi.models.catalogue | vi.models.control_catalogue).items():
        print(f"{name:28} {factory().claim}")


def run(asked: argparse.Namespace) -> None:
    """Simulate or solve, say how well, and write the files that were asked for."""
    model, params = chosen(asked)
    # a model without one is refused before it runs
    sketch = vi.models.sketch(model) if asked.animate else None
    if isinstance(model, ControlModel):
        motion = _solve(model, asked)
    else:
        motion = _simulate(model, start_of(model, params, asked), asked)
    if asked.save:
        motion.save(_folder(asked.save))
    if asked.plot:
        motion.plot().savefig(_folder(asked.plot), dpi=120)
    if asked.animate:
        lasts = abs(motion.duration)
        speed = asked.speed or (1.0 if FILM[0] <= lasts <= FILM[1] else lasts / 10)
        motion.animate(_folder(asked.animate), sketch=sketch, speed=speed)
        print(f"a second of the film is {speed:g} of the motion's time")
    for path in (asked.save, asked.plot, asked.animate):
        if path:
            print(f"wrote {path}")


def _simulate(model: Model, start: dict[str, Any], asked: argparse.Namespace) -> vi.Trajectory:
    """The motion; prints energy, the model's invariants, and the error where the motion is
    known.
    """
    motion = vi.simulate(model.system, asked.rule, **start)
    print(f"{model.name}: {model.claim}\n{model.source}\n")
    print(vi.plan(model.system, asked.rule), f"\n\n{motion}, {motion.stats['seconds']:.2f} s")
    for event in motion.events:
        print(f"{event.kind} at t = {event.time:.12g}")
    for name, expression in model.invariants.items():
        values = motion.value(expression)
        print(
            f"{name:24} changes by {np.abs(values - values[0]).max():.1e} at most, of "
            f"{np.abs(values).max():.6g}"
        )
    if model.exact is not None:
        q, _ = model.exact(motion.t)
        print(f"{'q':24} differs from the exact motion by {np.abs(motion.q - q).max():.1e} at most")
    return motion


def _solve(model: ControlModel, asked: argparse.Namespace) -> vi.Trajectory:
    """The optimal motion, of the first phase where there are several; prints the report of each."""
    if asked.rule or asked.h or asked.duration:
        raise vi.InputError(
            f"{model.name} comes with its own rule, steps and duration: leave out --rule, --h, "
            "--duration"
        )
    print(f"{model.name}: {model.claim}\n{model.source}\n")
    motions = model.solve()
    for motion in motions:
        motion.report()
    if model.cost is not None:
        print(f"cost found {sum(motion.cost for motion in motions):.12g}   known {model.cost:.12g}")
    return motions[0]


def check(asked: argparse.Namespace) -> int:
    """All self-tests on a model; exit code 1 where one fails."""
    model, start = simulated(asked, "check")
    steps = max(round(start.pop("duration") / start["h"]), 1)
    result = vi.diagnostics.self_test(model.system, asked.rule, steps=steps, **start)
    print(result)
    return 0 if result.passed else 1


def bench(asked: argparse.Namespace) -> None:
    """Run time against error for the rules that fit the model."""
    model, start = simulated(asked, "bench")
    start.pop("h")
    structure = model.system.structure
    if structure.degenerate or structure.nonholonomic:
        raise vi.InputError(
            f"{model.name} has nothing to compare: one rule alone steps it; see `run {model.name}`"
        )
    rules = [] if structure.constraints or structure.contacts else [vi.gauss(s) for s in (1, 2, 4)]
    rules += [vi.lobatto(s) for s in (2, 3, 4)] if not rules else []
    rules += [vi.composition(name) for name in EXPLICIT] if structure.explicit else []
    result = vi.diagnostics.work_precision(model.system, rules, steps=STEPS, **start)
    print(result)
    if asked.plot:
        result.plot().savefig(_folder(asked.plot), dpi=120)
        print(f"wrote {asked.plot}")


def play(asked: argparse.Namespace) -> None:
    """Serve the page of a model until it is interrupted."""
    model, start = simulated(asked, "play")
    serve(scene_of_start(model, asked.rule, start), asked.port, not asked.no_browser)


def _folder(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


if __name__ == "__main__":
    sys.exit(main())
