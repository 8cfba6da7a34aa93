"""Reference values; each entry of `reference/` says where it comes from."""

from __future__ import annotations

import json
from pathlib import Path


def entries(name: str) -> dict:
    """The entries of a file of `reference/`, by their names."""
    path = Path(__file__).parent / "reference" / f"{name}.json"
    return json.loads(path.read_text(encoding="utf-8"))


def given_and_exact(name: str, entry: str) -> tuple[dict, dict]:
    """What an entry of a file is for, and its values."""
    found = entries(name)[entry]
    return found["params"], found["reference"]
