"""One page per example: its Lagrangian, claim and source, the figure it draws, what it prints,
and its code.
"""

from __future__ import annotations

import hashlib
import html
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import cards
from chapters import CHAPTERS
from state import ROOT, package_state, say, write_if_changed, write_whole

HERE = Path(__file__).resolve().parent
EXAMPLES = ROOT / "examples"
WITHOUT_DATA = "This example reads"  # an optional package of data that is not there
SLOWEST = 1200  # seconds, on a machine that has much else to do


@dataclass(frozen=True)
class Example:
    """What an example's docstring says."""

    name: str
    title: str
    lead: str
    claim: str
    source: str
    code: str


def example(path: Path) -> Example:
    """Read an example; its docstring is a sentence "Title: lead.", then paragraphs "Claim: …", "Source: …",
    "Run: …".
    """
    code = path.read_text(encoding="utf-8")
    text = code.split('"""')[1]
    parts = dict(
        re.findall(r"^(Claim|Source|Run): (.*?)(?=^(?:Claim|Source|Run): |\Z)", text, re.M | re.S)
    )
    words = {name: " ".join(part.split()) for name, part in parts.items()}
    first = " ".join(text.strip().split("\n\n")[0].split())
    title, _, lead = first.partition(": ")
    lead = lead[:1].upper() + lead[1:]
    title = title.rstrip(".")
    return Example(path.stem, title, lead, words["Claim"], words["Source"], code)


def chapters() -> dict[str, list[str]]:
    """Examples by chapter; those without a place yet come last."""
    there = {path.stem for path in EXAMPLES.glob("*.py")}
    known = {name for names in CHAPTERS.values() for name in names}
    found = {title: [name for name in names if name in there] for title, names in CHAPTERS.items()}
    found["Further examples"] = sorted(there - known)
    return {title: names for title, names in found.items() if names}


def write(folder: Path, jobs: int) -> None:
    """Run every example that changed, and write the gallery's pages into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    names = [name for chapter in chapters().values() for name in chapter]
    changed = [name for name in names if _kept(name, folder) is None]
    if changed:
        say(f"running {len(changed)} of {len(names)} examples, {jobs} at a time")

    undrawn = [name for name in cards.SCENES if not cards.is_kept(name, folder)]
    if undrawn:
        say(f"drawing {len(undrawn)} cards after them, {jobs} at a time")

    def draw(part: int) -> None:
        """Every so many cards in a process."""
        command = [sys.executable, "-W", "ignore", str(HERE / "cards.py"), str(folder)]
        some = undrawn[part::jobs]
        if some:
            subprocess.run([*command, *some], check=True, env=_environment(), cwd=folder)

    def run(at: int) -> str:
        started = time.perf_counter()
        printed = _run(changed[at], folder)
        seconds = time.perf_counter() - started
        say(f"examples/{changed[at]}.py ({at + 1} of {len(changed)}) took {seconds:.1f} s")
        return printed

    with ThreadPoolExecutor(jobs) as pool:
        new = dict(zip(changed, pool.map(run, range(len(changed))), strict=True))
        list(pool.map(draw, range(jobs)))
    outputs = {name: new.get(name) or _kept(name, folder) or "" for name in names}
    pages = {
        f"{name}.md": _page(example(EXAMPLES / f"{name}.py"), outputs[name], folder)
        for name in names
    }
    pages["index.md"] = _index()
    for name, text in pages.items():
        write_if_changed(folder / name, text)
    for stale in {path.name for path in folder.glob("*.md")} - set(pages):
        (folder / stale).unlink()


def _run(name: str, folder: Path) -> str:
    """What the example prints; its figure is in `folder` afterwards."""
    path, log, picture = EXAMPLES / f"{name}.py", folder / f".{name}.txt", folder / f"{name}.png"
    command = [sys.executable, "-W", "error", str(HERE / "run_example.py"), str(path)]
    with (
        tempfile.TemporaryDirectory() as empty
    ):  # an example writes to the folder `out` of where it runs
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            env=_environment(),
            timeout=SLOWEST,
            encoding="utf-8",
            cwd=empty,
        )
        drawn = Path(empty) / "out" / picture.name
        if (
            done.returncode and WITHOUT_DATA in done.stderr
        ):  # said on its page, tried anew next time
            picture.unlink(missing_ok=True)
            return done.stderr.strip()
        if done.returncode or not drawn.exists():
            raise RuntimeError(f"examples/{name}.py failed:\n{done.stderr[-2000:]}")
        shutil.copy(drawn, picture)
        shutil.copy(drawn.with_stem(f"{name}-dark"), picture.with_stem(f"{name}-dark"))
    write_whole(log, done.stdout)
    write_whole(folder / f".{name}.state", _state(name))
    return done.stdout


def _environment() -> dict[str, str]:
    """Of a process that draws without a screen."""
    own = {"MPLBACKEND": "Agg", "PYTHONPATH": str(ROOT), "PYTHONIOENCODING": "utf-8"}
    return os.environ | own


def _state(name: str) -> str:
    """A digest of all that an example's output depends on."""
    code = (EXAMPLES / f"{name}.py").read_bytes()
    code += (HERE / "run_example.py").read_bytes() + (HERE / "dark.py").read_bytes()
    return hashlib.sha256(code + package_state().encode()).hexdigest()


def _kept(name: str, folder: Path) -> str | None:
    """What the example printed when it last ran, if nothing has changed since."""
    stamp, log, picture = folder / f".{name}.state", folder / f".{name}.txt", folder / f"{name}.png"
    if stamp.exists() and stamp.read_text() == _state(name) and picture.exists():
        return log.read_text(encoding="utf-8")
    return None


def lagrangian(it: Example) -> str:
    """The example's Lagrangian, displayed; nothing for one without a place."""
    found = next((names[it.name] for names in CHAPTERS.values() if it.name in names), "")
    return f"$$\n{found}\n$$\n\n" if found else ""


def _page(it: Example, printed: str, folder: Path) -> str:
    lead = f"{it.lead}\n\n" if it.lead else ""
    alt = it.claim.replace('"', "'").replace("\\", "")
    film = ""
    if (folder / f"{it.name}-film.gif").exists():
        film = _picture(f"{it.name}-film.gif", f"Film: {alt}", "film")
    kinds = (("", "only-light"), ("-dark", "only-dark"))
    pictures = "".join(
        _picture(f"{it.name}{kind}.png", alt, f"gallery {mode}", f"../_images/{it.name}{kind}.png")
        for kind, mode in (kinds if (folder / f"{it.name}.png").exists() else ())
    )
    return (
        f"# {it.title}\n\n{lead}{lagrangian(it)}**Claim.** {it.claim}\n\n*Source:* {it.source}\n\n"
        f"{pictures}{film}"
        f"## What it prints\n\n```text\n{printed.rstrip()}\n```\n\n"
        f"## The code\n\n`python examples/{it.name}.py`\n\n"
        f"```{{code-block}} python\n:class: still\n\n{it.code.rstrip()}\n```\n"
    )


def _picture(file: str, alt: str, kind: str, target: str = "") -> str:
    """A picture that is loaded when it comes into view."""
    link = f":target: {target}\n" if target else ""
    return f"```{{image}} {file}\n:alt: {alt}\n:class: {kind}\n:loading: lazy\n{link}```\n\n"


def _index() -> str:
    text = [
        "# Gallery\n\nEvery scene states a claim and its source, draws one figure and prints "
        "numbers beside the exact ones. The pages are made by running the examples.\n"
    ]
    for title, names in chapters().items():
        cards = "\n".join(_card(example(EXAMPLES / f"{name}.py")) for name in names)
        toctree = "\n".join(names)
        text.append(
            f'## {title}\n\n```{{raw}} html\n<div class="cards">\n{cards}\n</div>\n```\n\n'
            f"```{{toctree}}\n:hidden:\n\n{toctree}\n```\n"
        )
    return "\n".join(text)


def _card(it: Example) -> str:
    """A small picture that leads to the page, with its claim for those who do not see it."""
    claim = html.escape(it.claim)
    return (
        f'<a href="{it.name}.html"><img src="../_cards/{it.name}.png" width="390" height="240" '
        f'loading="lazy" alt="{claim}"><span>{it.title}</span></a>'
    )
