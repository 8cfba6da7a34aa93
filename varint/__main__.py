"""The command line: `python -m varint list | run | check | bench`."""

from __future__ import annotations

import argparse
import re
import sys
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np

import varint as vi
from varint.models import ControlModel, Model

FAMILIES: dict[str, Callable[..., vi.Rule]] = {
    "gauss": vi.gauss,
    "lobatto": vi.lobatto,
    "midpoint": vi.midpoint,
    "trapezoidal": vi.trapezoidal,
}
EXPLICIT = ("verlet", "blanes-moan4", "blanes-moan6", "kahan-li8")  # of all compositions those worth comparing first
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
            return int(asked.command(asked) or 0)
        except (vi.VarintError, OSError) as error:
            print(f"varint: {error}", file=sys.stderr)
            return 2


def parser() -> argparse.ArgumentParser:
    """All commands with their options."""
    top = argparse.ArgumentParser(prog="python -m varint", description="Mechanics by the principle of least action.")
    top.add_argument("--version", action="version", version=f"varint {vi.__version__}")
    top.set_defaults(command=None)
    commands = top.add_subparsers(metavar="COMMAND")
    command = commands.add_parser("list", help="the ready models")
    command.set_defaults(command=list_models)
    for name, function, text in (
        ("run", run, "simulate a model, or solve one of optimal control"),
        ("check", check, "measure order, structure, energy, constraints and momenta on a model"),
        ("bench", bench, "run time against error of several rules on a model"),
    ):
        command = commands.add_parser(name, help=text, description=f"{text[0].upper()}{text[1:]}.")
        command.set_defaults(command=function)
        command.add_argument("model", metavar="MODEL", help="its name, see `list`")
        command.add_argument("--duration", type=positive, metavar="T", help="time span (default: the model's)")
        if name != "bench":
            command.add_argument("--rule", type=rule, help="such as gauss(2), lobatto(3), midpoint, blanes-moan6")
            command.add_argument("--h", type=positive, help="step (default: the model's)")
        if name != "check":
            command.add_argument(
                "--plot", type=file(*FIGURES), metavar="FILE", help="write a figure (.png, .pdf, .svg)"
            )
        if name == "run":
            command.add_argument(
                "--animate", type=file(*FILMS), metavar="FILE", help="write an animation (.gif, .mp4, .html)"
            )
            command.add_argument(
                "--speed",
                type=positive,
                help="time of the motion per second of film (default: 1, or for a film of 10 s)",
            )
            command.add_argument("--save", type=file(*DATA), metavar="FILE", help="write the trajectory (.npz)")
    return top


def positive(text: str) -> float:
    """A positive number."""
    try:
        number = float(text)
    except ValueError:
        number = np.nan
    if not 0 < number < np.inf:
        raise argparse.ArgumentTypeError(f"{text} is no positive number")
    return number


def file(*kinds: str) -> Callable[[str], Path]:
    """Reads the name of a file of one of these kinds, before anything runs."""

    def path(text: str) -> Path:
        if Path(text).suffix.lower() not in kinds:
            raise argparse.ArgumentTypeError(f"{text} must end in {' or '.join(kinds)}")
        return Path(text)

    return path


def rule(text: str) -> vi.Rule:
    """The rule of a name such as ``gauss(3)``, ``midpoint`` or ``blanes-moan6``."""
    match = re.fullmatch(r"(\w+)(?:\((\d*)\))?", text.strip())
    try:
        if match and match[1] in FAMILIES:
            return FAMILIES[match[1]](*([int(match[2])] if match[2] else []))
        return vi.composition(re.sub(r"^composition\(['\"]?(.*?)['\"]?\)$", r"\1", text.strip()))
    except TypeError:
        raise argparse.ArgumentTypeError(f"{text}: write gauss(2), lobatto(3), midpoint or trapezoidal") from None
    except vi.VarintError as error:
        raise argparse.ArgumentTypeError(f"{text} is no rule: {error}; or gauss(2), lobatto(3), midpoint") from None


def model_of(name: str) -> Model | ControlModel:
    """The model of this name.

    Raises
    ------
    InputError
        If there is none; the message has the names most like it.
    """
    every = vi.models.catalogue | vi.models.control_catalogue
    if name in every:
        return every[name]()
    from difflib import get_close_matches

    near = get_close_matches(name, every, 3, 0.4) or list(every)[:3]
    raise vi.InputError(f"unknown model {name!r}; did you mean {', '.join(near)}? `python -m varint list` has all")


def simulated(name: str, what: str) -> Model:
    """A model that is simulated, not solved."""
    model = model_of(name)
    if isinstance(model, ControlModel):
        raise vi.InputError(f"{name} is an optimal control problem, which `{what}` is not for; use `run {name}`")
    return model


def list_models(asked: argparse.Namespace) -> None:
    """Names and claims."""
    for name, factory in (vi.models.catalogue | vi.models.control_catalogue).items():
        print(f"{name:28} {factory().claim}")


def run(asked: argparse.Namespace) -> None:
    """Simulate or solve, say how well, and write the files that were asked for."""
    model = model_of(asked.model)
    sketch = vi.models.sketch(model) if asked.animate else None  # a model without one is refused before it runs
    motion = _solve(model, asked) if isinstance(model, ControlModel) else _simulate(model, asked)
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


def _simulate(model: Model, asked: argparse.Namespace) -> vi.Trajectory:
    """The motion; prints energy, the model's invariants, and the error where the motion is known."""
    motion = vi.simulate(model.system, asked.rule, **_start(model, asked))
    print(f"{model.name}: {model.claim}\n{model.source}\n")
    print(vi.plan(model.system, asked.rule), f"\n\n{motion}, {motion.stats['seconds']:.2f} s")
    for event in motion.events:
        print(f"{event.kind} at t = {event.time:.12g}")
    for name, expression in model.invariants.items():
        values = motion.value(expression)
        print(f"{name:24} changes by {np.abs(values - values[0]).max():.1e} at most, of {np.abs(values).max():.6g}")
    if model.exact is not None:
        q, _ = model.exact(motion.t)
        print(f"{'q':24} differs from the exact motion by {np.abs(motion.q - q).max():.1e} at most")
    return motion


def _solve(model: ControlModel, asked: argparse.Namespace) -> vi.Trajectory:
    """The optimal motion, of the first phase where there are several; prints the report of each."""
    if asked.rule or asked.h or asked.duration:
        raise vi.InputError(
            f"{model.name} comes with its own rule, steps and duration: leave out --rule, --h, --duration"
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
    model = simulated(asked.model, "check")
    start = _start(model, asked)
    steps = max(round(start.pop("duration") / start["h"]), 1)
    result = vi.diagnostics.self_test(model.system, asked.rule, steps=steps, **start)
    print(result)
    return 0 if result.passed else 1


def bench(asked: argparse.Namespace) -> None:
    """Run time against error for the rules that fit the model."""
    model = simulated(asked.model, "bench")
    start = _start(model, asked)
    start.pop("h")
    structure = model.system.structure
    if structure.degenerate or structure.nonholonomic:
        raise vi.InputError(f"{model.name} has nothing to compare: one rule alone steps it; see `run {model.name}`")
    rules = [] if structure.constraints or structure.contacts else [vi.gauss(s) for s in (1, 2, 4)]
    rules += [vi.lobatto(s) for s in (2, 3, 4)] if not rules else []
    rules += [vi.composition(name) for name in EXPLICIT] if structure.explicit else []
    result = vi.diagnostics.work_precision(model.system, rules, steps=STEPS, **start)
    print(result)
    if asked.plot:
        result.plot().savefig(_folder(asked.plot), dpi=120)
        print(f"wrote {asked.plot}")


def _start(model: Model, asked: argparse.Namespace) -> dict:
    """The model's start with the step and time span that were asked for, the duration a whole number of steps."""
    start = dict(model.start)
    start["h"] = getattr(asked, "h", None) or start["h"]
    start["duration"] = asked.duration or start["duration"]
    steps = round(start["duration"] / start["h"])
    if not steps:
        raise vi.InputError(f"a step of {start['h']:g} is longer than the motion, {start['duration']:g}; change --h")
    return start | {"duration": steps * start["h"]}


def _folder(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


if __name__ == "__main__":
    sys.exit(main())
