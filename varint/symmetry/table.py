"""The symmetries of a scene as a table for terminals and notebooks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from varint.errors import InputError
from varint.rules.rule import Rule
from varint.symmetry.symmetry import Symmetry

WIDEST = 44  # characters of a column


@dataclass(frozen=True, eq=False)
class Symmetries:
    """The symmetries of a scene; iterate, or pick one by number or name.

    Attributes
    ----------
    items : tuple of Symmetry
    rule : Rule or None
        The rule that the table's last column speaks of; None: rules in general.
    note : str
        What the search left out.
    """

    items: tuple[Symmetry, ...]
    rule: Rule | None = None
    note: str = ""

    def __len__(self) -> int:
        return len(self.items)

    def __iter__(self) -> Iterator[Symmetry]:
        return iter(self.items)

    def __getitem__(self, which: int | str) -> Symmetry:
        if not isinstance(which, str):
            return self.items[which]
        for item in self.items:
            if item.name == which:
                return item
        raise InputError(
            f"no symmetry is called {which!r}; there are {[item.name for item in self.items]}"
        )

    def rows(self) -> list[tuple[str, str, str, str]]:
        """Name, generator, conserved quantity, and what keeps or breaks it."""
        return [
            (s.name, s.generator, s.formula, s.kept_by(self.rule) if self.rule else s.kept)
            for s in self
        ]

    def __str__(self) -> str:
        if not self.items:
            return "no symmetries" + (f"\n{self.note}" if self.note else "")
        head = ("symmetry", "generator", "conserved quantity", f"kept by {self.rule or 'rules'}")
        table = [head, *(tuple(_short(x) for x in row) for row in self.rows())]
        widths = [max(len(row[i]) for row in table) for i in range(4)]
        lines = [
            "  ".join(x.ljust(w) for x, w in zip(row, widths, strict=True)).rstrip()
            for row in table
        ]
        lines.insert(1, "  ".join("─" * w for w in widths))
        return "\n".join([*lines, *([self.note] if self.note else [])])

    __repr__ = __str__

    def _repr_html_(self) -> str:
        from html import escape

        head = "".join(
            f"<th>{x}</th>" for x in ("symmetry", "generator", "conserved quantity", "kept")
        )
        body = "".join(
            "<tr>"
            + "".join(
                f"<td><code>{escape(x)}</code></td>" if 0 < i < 3 else f"<td>{escape(x)}</td>"
                for i, x in enumerate(row)
            )
            + "</tr>"
            for row in self.rows()
        )
        table = f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
        return f"{table}<p>{escape(self.note)}</p>"


def _short(text: str) -> str:
    return text if len(text) <= WIDEST else text[: WIDEST - 1] + "…"
