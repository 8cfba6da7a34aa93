"""One page per example: its Lagrangian, claim and source, the figure it draws, what it prints,
and its code.
"""

from __future__ import annotations

import ast
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
from functools import cache
from pathlib import Path

from chapters import CHAPTERS

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
EXAMPLES = ROOT / "examples"
SLOWEST = 300  # seconds


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
    """Read an example; its docstring is a title line, then paragraphs "Claim: …", "Source: …",
    "Run: …".
    """
    code = path.read_text(encoding="utf-8")
    text = code.split('"""')[1]
    parts = dict(
        re.findall(r"^(Claim|Source|Run): (.*?)(?=^(?:Claim|Source|Run): |\Z)", text, re.M | re.S)
    )
    words = {name: " ".join(part.split()) for name, part in parts.items()}
    title, _, lead = text.split("\n")[0].strip().rstrip(".").partition(": ")
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

    def run(at: int) -> str:
        started = time.perf_counter()
        printed = _run(changed[at], folder)
        seconds = time.perf_counter() - started
        say(f"examples/{changed[at]}.py ({at + 1} of {len(changed)}) took {seconds:.1f} s")
        return printed

    with ThreadPoolExecutor(jobs) as pool:
        new = dict(zip(changed, pool.map(run, range(len(changed))), strict=True))
    outputs = {name: new.get(name) or _kept(name, folder) or "" for name in names}
    pages = {f"{name}.md": _page(example(EXAMPLES / f"{name}.py"), outputs[name]) for name in names}
    pages["index.md"] = _index()
    for name, text in pages.items():
        write_if_changed(folder / name, text)
    for stale in {path.name for path in folder.glob("*.md")} - set(pages):
        (folder / stale).unlink()


def write_if_changed(path: Path, text: str) -> None:
    """Leave an unchanged page's time stamp alone, so that it is not read again."""
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")


@cache
def package_state() -> str:
    """A digest of the package's code, without its comments and docstrings: what was measured with
    it is kept until it changes.
    """
    digest = hashlib.sha256()
    for path in sorted((ROOT / "varint").rglob("*")):
        if path.suffix == ".py":
            digest.update(code_only(path.read_text(encoding="utf-8")).encode())
        elif path.suffix in {".c", ".h"}:
            digest.update(path.read_bytes())
    return digest.hexdigest()


def code_only(text: str) -> str:
    """What a module does: its syntax tree, without docstrings."""
    tree = ast.parse(text)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if not isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)) or not body:
            continue
        first = body[0]
        if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
            body[:1] = [ast.Pass()]
    return ast.dump(tree)


def say(text: str) -> None:
    """A line of progress, which Sphinx's quiet mode leaves alone."""
    print(f"docs: {text}", file=sys.stderr, flush=True)


def _run(name: str, folder: Path) -> str:
    """What the example prints; its figure is in `folder` afterwards."""
    path, log, picture = EXAMPLES / f"{name}.py", folder / f".{name}.txt", folder / f"{name}.png"
    environment = os.environ | {
        "MPLBACKEND": "Agg",
        "PYTHONPATH": str(ROOT),
        "PYTHONIOENCODING": "utf-8",
    }
    command = [sys.executable, "-W", "error", str(path)]
    with (
        tempfile.TemporaryDirectory() as empty
    ):  # an example writes to the folder `out` of where it runs
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            env=environment,
            timeout=SLOWEST,
            encoding="utf-8",
            cwd=empty,
        )
        drawn = Path(empty) / "out" / picture.name
        if done.returncode or not drawn.exists():
            raise RuntimeError(f"examples/{name}.py failed:\n{done.stderr[-2000:]}")
        shutil.copy(drawn, picture)
    log.write_text(done.stdout, encoding="utf-8")
    (folder / f".{name}.state").write_text(_state(name))
    return done.stdout


def _state(name: str) -> str:
    """A digest of all that an example's output depends on."""
    code = (EXAMPLES / f"{name}.py").read_bytes()
    return hashlib.sha256(code + package_state().encode()).hexdigest()


def _kept(name: str, folder: Path) -> str | None:
    """What the example printed when it last ran, if nothing has changed since."""
    stamp, log, picture = folder / f".{name}.state", folder / f".{name}.txt", folder / f"{name}.png"
    if stamp.exists() and stamp.read_text() == _state(name) and picture.exists():
        return log.read_text(encoding="utf-8")
    return None


def _page(it: Example, printed: str) -> str:
    lagrangian = next((names[it.name] for names in CHAPTERS.values() if it.name in names), "")
    formula = f"$$\n{lagrangian}\n$$\n\n" if lagrangian else ""
    lead = f"{it.lead[:1].upper()}{it.lead[1:]}.\n\n" if it.lead else ""
    alt = it.claim.replace('"', "'").replace("\\", "")
    return (
        f"# {it.title}\n\n{lead}{formula}**Claim.** {it.claim}\n\n*Source:* {it.source}\n\n"
        f"```{{figure}} {it.name}.png\n:alt: {alt}\n:class: gallery\n"
        f":target: ../_images/{it.name}.png\n\n{it.title}.\n```\n\n"
        f"## What it prints\n\n```text\n{printed.rstrip()}\n```\n\n"
        f"## The code\n\n`python examples/{it.name}.py`\n\n"
        f"```{{code-block}} python\n:class: still\n\n{it.code.rstrip()}\n```\n"
    )


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
        f'<a href="{it.name}.html"><img src="../_images/{it.name}.png" '
        f'alt="{claim}"><span>{it.title}</span></a>'
    )
