"""The exercises of the course: answers are checked by computing, so that any right one is right.

``check(number, answer)`` judges; ``exercises`` holds all of them by number.
"""

from varint.course.check import Verdict, check
from varint.course.exercise import Exercise
from varint.course.table import exercises

__all__ = ["Exercise", "Verdict", "check", "exercises"]
