"""Short tables for notebooks."""

from __future__ import annotations

from collections.abc import Sequence


def table(title: str, rows: Sequence[tuple[str, str]], picture: str = "") -> str:
    """A heading, rows of (what, value), and a picture beside them, as HTML.

    Examples
    --------
    >>> from varint.notation.html import table
    >>> table("rule", [("order", "4")])
    '<div><strong>rule</strong><table><tr><th>order</th><td>4</td></tr></table></div>'
    """
    from html import escape  # its table of entities takes a millisecond

    body = "".join(f"<tr><th>{escape(what)}</th><td>{escape(x)}</td></tr>" for what, x in rows)
    return f"<div><strong>{escape(title)}</strong><table>{body}</table>{picture}</div>"
