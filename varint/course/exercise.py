"""What an exercise is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Exercise:
    """A task, and what judges its answers by computing.

    Attributes
    ----------
    task : str
        What is asked.
    complaint : callable
        What is wrong with an answer, in words; empty where it is right.
    """

    task: str
    complaint: Callable[[Any], str]
