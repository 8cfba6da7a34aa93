"""Where benchmarks leave their numbers: benchmarks/results/<name>.json, with when and on what
they were measured.
"""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Mapping
from datetime import datetime, timezone
from pathlib import Path
from types import MappingProxyType
from typing import Any

import casadi as ca
import numpy as np

import varint as vi

FOLDER = Path(__file__).parents[1] / "results"


def save(
    name: str,
    rows: list[dict[str, Any]],
    peers: Mapping[str, str] = MappingProxyType({}),
    means: Mapping[str, float] = MappingProxyType({}),
) -> None:
    """`write`, and say where it is."""
    print(f"written to {write(name, rows, peers, means).relative_to(FOLDER.parents[1])}")


def write(
    name: str,
    rows: list[dict[str, Any]],
    peers: Mapping[str, str] = MappingProxyType({}),
    means: Mapping[str, float] = MappingProxyType({}),
) -> Path:
    """Write the rows of a benchmark, with the versions of other tools and geometric means of
    ratios: the file.
    """
    FOLDER.mkdir(exist_ok=True)
    path = FOLDER / f"{name}.json"
    about: dict[str, Any] = {"measured_with": measured_with() | dict(peers)}
    if means:
        about["geometric means"] = dict(means)
    path.write_text(json.dumps(about | {"rows": rows}, indent=1) + "\n")
    return path


def kept(name: str) -> list[dict[str, Any]]:
    """The rows of a benchmark as they were left; none where there are none."""
    path = FOLDER / f"{name}.json"
    return json.loads(path.read_text())["rows"] if path.exists() else []


def with_scene(
    rows: list[dict[str, Any]], new: list[dict[str, Any]], scenes: list[str]
) -> list[dict[str, Any]]:
    """Rows in the order of the scenes, those of the scenes that were measured anew replaced."""
    again = {row["scene"] for row in new}
    both = [row for row in rows if row["scene"] not in again] + new
    return sorted(both, key=lambda row: scenes.index(row["scene"]))


def measured_with() -> dict[str, Any]:
    """Date, machine and versions."""
    return {
        "date": datetime.now(timezone.utc).date().isoformat(),
        "machine": f"{platform.system()} {platform.machine()}",
        "processor": _processor(),
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        "varint": vi.__version__,
        "casadi": ca.__version__,
        "numpy": np.__version__,
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    return next(
        (x.split(":")[1].strip() for x in lines if x.startswith("model name")), platform.machine()
    )


def table(rows: list[dict[str, Any]]) -> None:
    """Print rows as a table; numbers with three digits."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    cells = [names] + [[_text(row.get(name)) for name in names] for row in rows]
    widths = [max(len(line[i]) for line in cells) for i in range(len(names))]
    for line in cells:
        print("  ".join(x.rjust(w) for x, w in zip(line, widths, strict=True)))


def _text(x: Any) -> str:
    if x is None:
        return ""
    return f"{x:.3g}" if isinstance(x, float) else str(x)
