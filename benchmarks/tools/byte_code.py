"""The package as it is installed: its modules compiled to byte code."""

import compileall
from pathlib import Path

PACKAGE = Path(__file__).parents[2] / "varint"


def make_byte_code() -> None:
    """What pip does with every package, the peers among them, and a checkout whose Python must not
    write has not: without it each process reads its modules anew.
    """
    compileall.compile_dir(PACKAGE, quiet=2)
