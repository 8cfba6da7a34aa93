"""The benchmark page: what `python3 tasks.py bench` left in benchmarks/results, with machine and date."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

from gallery import write_if_changed

RESULTS = Path(__file__).resolve().parents[2] / "benchmarks" / "results"
LONGEST = 40  # rows: longer tables are measured clouds, which the figure shows
HEAD = """# Benchmarks

Speed is a ratio, measured side by side on one machine, at equal error. `python3 tasks.py bench` measures again and
writes `benchmarks/results/*.json`, from which this page is made. Your own scene: `vi.diagnostics.work_precision`, or
`python -m varint bench pendulum`.
"""


def write(path: Path) -> None:
    """One section per result file, with the figure of the same name."""
    files = sorted(RESULTS.glob("*.json"))
    parts = [_file(file, path.parent) for file in files]
    write_if_changed(path, "\n".join([HEAD, *(parts or ["No results have been stored for this version yet.\n"])]))


def _file(file: Path, source: Path) -> str:
    result = json.loads(file.read_text(encoding="utf-8"))
    result = result if isinstance(result, dict) else {"rows": result}
    title = result.pop("title", None) or _words(file.stem).capitalize()
    lines = [f"## {title}\n", f"From `benchmarks/results/{file.name}`.\n"]
    picture = file.with_suffix(".png")
    if picture.exists():
        (source / "_build").mkdir(exist_ok=True)
        shutil.copy(picture, source / "_build" / picture.name)
        words = f"{title}: the table's numbers as a figure"
        lines.append(f"```{{figure}} _build/{picture.name}\n:alt: {words}\n:class: gallery\n\n{words}.\n```\n")
    return "\n".join([*lines, *_section(result, 3)])


def _section(result: dict[str, Any], level: int) -> list[str]:
    """Scalars are facts, lists of records tables, mappings of mappings sections of their own."""
    lines = [f"- {_words(key)}: {_cell(value)}" for key, value in result.items() if not _nested(value)]
    lines.append("")
    for key, value in result.items():
        if isinstance(value, list) and value and all(isinstance(row, dict) for row in value):
            if len(value) <= LONGEST:
                lines += [*_table(value), ""]
        elif isinstance(value, dict) and value and all(isinstance(part, dict) for part in value.values()):
            for name, part in value.items():
                lines += [f"{'#' * level} {_words(name).capitalize()}\n", *_section(part, level + 1)]
        elif isinstance(value, dict) and any(not _nested(v) for v in value.values()):
            lines += [f"{_words(key).capitalize()}:", *_section(value, level + 1)]
    return lines


def _table(rows: list[dict]) -> list[str]:
    """Run times by wanted error and tool where that is what was measured; otherwise the records as they are."""
    if all({"wanted", "tool", "seconds"} <= set(row) for row in rows):
        tools = sorted({row["tool"] for row in rows}, key=lambda tool: (tool != "varint", tool))
        times = {(row["wanted"], row["tool"]): row["seconds"] for row in rows}
        wanted = sorted({row["wanted"] for row in rows}, reverse=True)
        rows = [
            {"wanted error": f"{error:.0e}"}
            | {f"{tool}, ms": 1000 * times[error, tool] if (error, tool) in times else "–" for tool in tools}
            for error in wanted
        ]
    columns = list(dict.fromkeys(key for row in rows for key, value in row.items() if not _nested(value)))
    head = ["| " + " | ".join(_words(c) for c in columns) + " |", "|" + "---|" * len(columns)]
    return head + ["| " + " | ".join(_cell(row.get(c, "–")) for c in columns) + " |" for row in rows]


def _words(name: str) -> str:
    return str(name).replace("_", " ")


def _nested(value: Any) -> bool:
    return isinstance(value, (dict, list))


def _cell(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value).replace("|", "\\|").replace("\n", " ")
