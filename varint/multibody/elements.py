"""XML files read as elements that know their line: nothing fetched, no entities, no path outside
the file's folder.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar
from xml.parsers import expat

import numpy as np

from varint.errors import InputError

T = TypeVar("T")


def words(text: str) -> tuple[str, ...]:
    """A list of names, written as they are read."""
    return tuple(text.split())


# A robot's file has some thousand elements; these hold a hundred times the largest that is known.
MOST_BYTES, MOST_ELEMENTS, DEEPEST = 32_000_000, 500_000, 400
SHOWN = 5  # lines that a warning lists for each kind of element


@dataclass(frozen=True, eq=False)
class Element:
    """An element of a file: its tag, its attributes, its children and where it stands."""

    tag: str
    attributes: Mapping[str, str]
    line: int
    source: str  # the file's name, or "text"
    children: list[Element] = field(default_factory=list)

    def __iter__(self) -> Iterator[Element]:
        return iter(self.children)

    @property
    def where(self) -> str:
        """`arm.urdf:12: <joint name="elbow">`."""
        named = self.attributes.get("name")
        label = f'<{self.tag} name="{named}">' if named else f"<{self.tag}>"
        return f"{self.source}:{self.line}: {label}"

    def all(self, *tags: str) -> list[Element]:
        """The children with one of these tags."""
        return [child for child in self.children if child.tag in tags]

    def one(self, tag: str) -> Element | None:
        """The child with this tag, None without one, refused with two."""
        found = self.all(tag)
        if len(found) > 1:
            lines = [child.line for child in found]
            raise InputError(f"{self.where} has {len(found)} <{tag}> (lines {lines}); keep one")
        return found[0] if found else None

    def text(self, name: str) -> str:
        """An attribute that must be there."""
        value = self.attributes.get(name, "").strip()
        if not value:
            raise InputError(f"{self.where} needs the attribute {name}")
        return value

    def optional(self, name: str, count: int | None = None, most: int = 0) -> np.ndarray | None:
        """`count` finite numbers of an attribute (1 to `most` for None), None without it."""
        text = self.attributes.get(name)
        if text is None:
            return None
        values = [finite(self, name, word) for word in text.split()]
        wrong = len(values) != count if count is not None else not 1 <= len(values) <= most
        if wrong:
            wanted = f"{count}" if count is not None else f"1 to {most}"
            raise InputError(
                f"{self.where}: {name}={text!r} has {len(values)} numbers; give {wanted}"
            )
        return np.array(values)

    def numbers(
        self, name: str, count: int | None, default: Any = None, most: int = 0
    ) -> np.ndarray:
        """The same, with a default or as an attribute that must be there."""
        if default is None:
            self.text(name)
        values = self.optional(name, count, most)
        return np.array(default, float) if values is None else values

    def number(self, name: str, default: float | None = None) -> float:
        """One finite number of an attribute, which must be there without a default."""
        if name not in self.attributes and default is not None:
            return default
        return finite(self, name, self.text(name))


def finite(element: Element, name: str, word: str) -> float:
    """A finite number from its text."""
    try:
        value = float(word)
    except ValueError:
        value = np.nan
    if not np.isfinite(value) or "_" in word:  # Python's 1_000 is no number of XML
        raise InputError(f"{element.where}: {name}={word!r} is no finite number")
    return value


def is_text(source: Any) -> bool:
    """Whether a string is the document itself rather than a path."""
    return isinstance(source, str) and source.lstrip("\ufeff \t\r\n").startswith("<")


def document(source: str | os.PathLike, folder: Any = None) -> tuple[Element, Path | None]:
    """The root element of a file or of a text, and the folder that its references stay in.

    `folder` takes the place of the file's own folder (a text has none).

    Raises
    ------
    InputError
        If there is no such file, it is too large or not well formed, or it declares a document
        type (and with it entities).
    """
    home = None if folder is None else existing_folder(folder)
    if is_text(source):
        return root_element(str(source).lstrip("\ufeff \t\r\n").encode(), "text"), home
    if not isinstance(source, (str, os.PathLike)):
        raise InputError(f"give a path or the text of a file, got {type(source).__name__}")
    path = Path(source)
    return root_element(contents(path), path.name), home or path.resolve().parent


def existing_folder(folder: Any) -> Path:
    """A folder that is there, without links."""
    path = Path(folder) if isinstance(folder, (str, os.PathLike)) else None
    if path is None or not path.is_dir():
        raise InputError(f"folder={folder!r} is no folder")
    return path.resolve()


def contents(path: Path) -> bytes:
    """The bytes of a file of reasonable size."""
    if not path.is_file():
        raise InputError(f"there is no file {str(path)!r} (a text must begin with '<')")
    size = path.stat().st_size
    if size > MOST_BYTES:
        raise InputError(f"{path.name} has {size} bytes; the limit is {MOST_BYTES}")
    return path.read_bytes()


def file_within(folder: Path | None, name: str, asked_by: Element) -> Path:
    """The file of that name in a folder or beneath it; whatever leads out of it is refused."""
    if folder is None:
        raise InputError(f"{asked_by.where}: {name!r} needs a folder; give folder= beside a text")
    if "://" in name or "\0" in name:
        raise InputError(
            f"{asked_by.where}: {name!r} is no file of this folder; nothing is fetched"
        )
    path = (folder / name).resolve()
    if not path.is_relative_to(folder):
        raise InputError(f"{asked_by.where}: {name!r} leads out of the folder {str(folder)!r}")
    if not path.is_file():
        raise InputError(f"{asked_by.where}: there is no file {str(path)!r}")
    return path


def root_element(data: bytes, source: str) -> Element:
    """The root of a document, without its comments and text."""
    if len(data) > MOST_BYTES:
        raise InputError(f"{source} has {len(data)} bytes; the limit is {MOST_BYTES}")
    parser = expat.ParserCreate()
    open_elements: list[Element] = []
    roots: list[Element] = []
    count = 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal count
        count += 1
        line = parser.CurrentLineNumber
        if count > MOST_ELEMENTS or len(open_elements) >= DEEPEST:
            raise InputError(
                f"{source}:{line}: more than {MOST_ELEMENTS} elements, or more than {DEEPEST} "
                "within one another"
            )
        element = Element(tag, attributes, line, source)
        (open_elements[-1].children if open_elements else roots).append(element)
        open_elements.append(element)

    def refuse_doctype(*_: Any) -> None:
        raise InputError(
            f"{source}:{parser.CurrentLineNumber}: a document type is not read (it could declare "
            "entities); delete the <!DOCTYPE …>"
        )

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: open_elements.pop() and None
    parser.StartDoctypeDeclHandler = refuse_doctype
    parser.EntityDeclHandler = refuse_doctype
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        reason = expat.ErrorString(error.code)
        raise InputError(f"{source}:{error.lineno}: no well-formed XML: {reason}") from None
    except (LookupError, ValueError) as error:  # an encoding that Python does not know
        if isinstance(error, InputError):
            raise
        raise InputError(f"{source}: its encoding cannot be read ({error})") from None
    return roots[0]


def located(element: Element, make: Callable[[], T]) -> T:
    """What `make` makes; its refusals name the element."""
    try:
        return make()
    except InputError as error:
        raise InputError(f"{element.where}: {error}") from None


class Unread:
    """What a file says and nobody used: collected while reading, said once at the end."""

    def __init__(self) -> None:
        self.lines: dict[str, list[tuple[str, int]]] = {}

    def note(self, element: Element, what: str = "", why: str = "") -> None:
        """An element, or its attribute `what`, is not used."""
        label = f"<{element.tag}>" + (f" {what}" if what else "") + (f" ({why})" if why else "")
        self.lines.setdefault(label, []).append((element.source, element.line))

    def only(self, element: Element, tags: Any = (), attributes: Any = None) -> None:
        """Note every child and attribute of an element that is not in these lists."""
        for child in element:
            if child.tag not in tags:
                self.note(child)
        for name in element.attributes:
            if attributes is not None and name not in attributes and not name.startswith("xmlns"):
                self.note(element, name)

    def said(self, source: str) -> str | None:
        """The words of the warning, None where all was used."""
        if not self.lines:
            return None
        words = []
        for label, spots in self.lines.items():
            shown = [f"{line}" if file == source else f"{file}:{line}" for file, line in spots]
            rest = f" and {len(shown) - SHOWN} more" if len(shown) > SHOWN else ""
            many = "s" if len(shown) > 1 else ""
            words.append(f"{label} on line{many} {', '.join(shown[:SHOWN])}{rest}")
        return f"{source}: read without " + "; ".join(words)
