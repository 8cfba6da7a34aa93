"""Run an example as it stands, and let its figure be saved for dark pages as well:
`python run_example.py FILE`.
"""

from __future__ import annotations

import runpy
import sys
from pathlib import Path
from typing import Any

import matplotlib.figure
from dark import darken, few_colours

SAVED = matplotlib.figure.Figure.savefig


def save(figure: Any, path: Any, **given: Any) -> None:
    """Save a figure; one that goes into a file of its own also as NAME-dark, both in few
    colours.
    """
    SAVED(figure, path, **given)
    if isinstance(path, (str, Path)) and Path(path).suffix == ".png":
        dark = Path(path).with_stem(f"{Path(path).stem}-dark")
        darken(figure)
        SAVED(figure, dark, **given)
        for file in (Path(path), dark):
            file.write_bytes(few_colours(file.read_bytes()))


if __name__ == "__main__":
    matplotlib.figure.Figure.savefig = save
    sys.argv = sys.argv[1:]
    runpy.run_path(sys.argv[0], run_name="__main__")
