"""What is kept between builds of the documentation, until what it depends on changes."""

from __future__ import annotations

import ast
import hashlib
import os
import sys
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def write_if_changed(path: Path, text: str) -> None:
    """Leave an unchanged page's time stamp alone, so that it is not read again."""
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        write_whole(path, text)


def write_whole(path: Path, text: str) -> None:
    """A build that is interrupted leaves the file that was there, or none."""
    part = path.with_name(f".{path.name}.{os.getpid()}")
    part.write_text(text, encoding="utf-8")
    part.replace(path)


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
