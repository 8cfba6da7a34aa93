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
from varint.models import Model

FAMILIES: dict[str, Callable[..., vi.Rule]] = {
    "gauss": vi.gauss,
    "lobatto": vi.lobatto,
    "midpoint": vi.midpoint,
    "trapezoidal": vi.trapezoidal,
}
EXPLICIT = ("verlet", "blanes-moan4", "blanes-moan6", "kahan-li8")  # of all compositions those worth comparing first
STEPS = (64, 128, 256, 512, 1024)


def main(arguments: list[str] | None = None) -> int:
    """Run one command; warnings and errors become one line each, an error the exit code 2."""
    asked = parser().parse_args(arguments)
    with warnings.catch_warnings():
        warnings.simplefilter("always", UserWarning)
        warnings.showwarning = lambda message, *_: print(f"varint: {message}", file=sys.stderr)
        try:
            return int(asked.command(asked) or 0)
        except vi.VarintError as error:
            print(f"varint: {error}", file=sys.stderr)
            return 2


def parser() -> argparse.ArgumentParser:
    """All commands with their options."""
    top = argparse.ArgumentParser(prog="python -m varint", description="Mechanics by the principle of least action.")
    commands = top.add_subparsers(required=True, metavar="COMMAND")
    command = commands.add_parser("list", help="the ready models")
    command.set_defaults(command=list_models)
    for name, function, text in (
        ("run", run, "simulate a model"),
        ("check", check, "measure order, structure, energy, constraints and momenta on a model"),
        ("bench", bench, "run time against error of several rules on a model"),
    ):
        command = commands.add_parser(name, help=text)
        command.set_defaults(command=function)
        command.add_argument("model", metavar="MODEL", help="its name, see `list`")
        command.add_argument("--duration", type=positive, help="time span (default: the model's)")
        if name != "bench":
            command.add_argument("--rule", type=rule, help="such as gauss(2), lobatto(3), midpoint, blanes-moan6")
            command.add_argument("--h", type=positive, help="step (default: the model's)")
        if name != "check":
            command.add_argument("--plot", type=Path, metavar="FILE", help="write a figure (.png, .pdf, .svg)")
        if name == "run":
            command.add_argument("--animate", type=Path, metavar="FILE", help="write an animation (.gif, .mp4, .html)")
            command.add_argument("--save", type=Path, metavar="FILE", help="write the trajectory (.npz)")
    return top


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


def positive(text: str) -> float:
    """A positive, finite number."""
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not (value > 0 and np.isfinite(value)):
        raise argparse.ArgumentTypeError(f"{text} is no positive number")
    return value


def model_of(name: str) -> Model:
    """The model of this name.

    Raises
    ------
    InputError
        If there is none; the message has the names most like it.
    """
    if name in vi.models.catalogue:
        return vi.models.catalogue[name]()
    from difflib import get_close_matches

    near = get_close_matches(name, vi.models.catalogue, 3, 0.4) or list(vi.models.catalogue)[:3]
    raise vi.InputError(f"unknown model {name!r}; did you mean {', '.join(near)}? `python -m varint list` has all")


def list_models(asked: argparse.Namespace) -> None:
    """Names and claims."""
    for name, factory in vi.models.catalogue.items():
        print(f"{name:28} {factory().claim}")


def run(asked: argparse.Namespace) -> None:
    """Simulate, and say how well: energy, the model's invariants, and the error where the motion is known."""
    model = model_of(asked.model)
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
    if asked.save:
        motion.save(asked.save)
    if asked.plot:
        motion.plot().savefig(_folder(asked.plot), dpi=120)
    if asked.animate:
        motion.animate(_folder(asked.animate), sketch=vi.models.sketch(model))
    for path in (asked.save, asked.plot, asked.animate):
        if path:
            print(f"wrote {path}")


def check(asked: argparse.Namespace) -> int:
    """All self-tests on a model; exit code 1 where one fails."""
    model = model_of(asked.model)
    start = _start(model, asked)
    steps = max(round(start.pop("duration") / start["h"]), 1)
    result = vi.diagnostics.self_test(model.system, asked.rule, steps=steps, **start)
    print(result)
    return 0 if result.passed else 1


def bench(asked: argparse.Namespace) -> None:
    """Run time against error for the rules that fit the model."""
    model = model_of(asked.model)
    start = _start(model, asked)
    start.pop("h")
    structure = model.system.structure
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
    start["duration"] = max(round(start["duration"] / start["h"]), 1) * start["h"]
    return start


def _folder(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


if __name__ == "__main__":
    sys.exit(main())
