"""What was chosen for a wanted accuracy."""

from __future__ import annotations

from dataclasses import dataclass

from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule


@dataclass(frozen=True, eq=False)
class Choice:
    """A rule and a number of steps, the run that they make, and its estimated error; whether its
    energy has been looked at and stays; by which of a scene's own time scales its steps vary.
    """

    rule: Rule
    steps: int
    motion: Trajectory
    estimate: float
    runs: int
    reached: bool
    level: bool = False
    time_scale: str = ""
