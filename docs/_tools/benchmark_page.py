"""The benchmark page: what `python3 tasks.py bench` left in benchmarks/results, with machine and date."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from gallery import write_if_changed

RESULTS = Path(__file__).resolve().parents[2] / "benchmarks" / "results"
HEAD = """# Benchmarks

Speed is a ratio, measured side by side on one machine, at equal error. `python3 tasks.py bench` measures again and
writes `benchmarks/results/*.json`, from which this page is made. Your own scene: `vi.diagnostics.work_precision`, or
`python -m varint bench pendulum`.
"""


def write(path: Path) -> None:
    """One section per result file."""
    files = sorted(RESULTS.glob("*.json"))
    parts = [_section(file.stem, json.loads(file.read_text(encoding="utf-8"))) for file in files]
    write_if_changed(path, "\n".join([HEAD, *(parts or ["No results have been stored for this version yet.\n"])]))


def _section(name: str, result: Any) -> str:
    """Scalars are what was measured where; lists of records are tables; nested mappings are sections of their own."""
    if isinstance(result, list):
        result = {"rows": result}
    title = result.get("title") or name.replace("_", " ").capitalize()
    lines = [f"## {title}\n"]
    facts = {k: v for k, v in result.items() if k != "title" and isinstance(v, (str, int, float, bool))}
    lines += [f"- {key.replace('_', ' ')}: {_cell(value)}" for key, value in facts.items()]
    for key, value in result.items():
        if isinstance(value, dict):
            lines += ["", *(f"- {key} {k.replace('_', ' ')}: {_cell(v)}" for k, v in value.items() if not _nested(v))]
        if isinstance(value, list) and value and all(isinstance(row, dict) for row in value):
            lines += ["", *_table(value)]
    return "\n".join([*lines, ""])


def _table(rows: list[dict]) -> list[str]:
    columns = list(dict.fromkeys(key for row in rows for key, value in row.items() if not _nested(value)))
    head = ["| " + " | ".join(c.replace("_", " ") for c in columns) + " |", "|" + "---|" * len(columns)]
    return head + ["| " + " | ".join(_cell(row.get(c, "–")) for c in columns) + " |" for row in rows]


def _nested(value: Any) -> bool:
    return isinstance(value, (dict, list))


def _cell(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value).replace("|", "\\|").replace("\n", " ")
