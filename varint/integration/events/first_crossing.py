"""The first zero of a watched expression along a motion: looked for only where it may be."""

from __future__ import annotations

from collections.abc import Mapping

from varint.codegen.kernel import Kernel
from varint.integration.events.crossings import Crossings
from varint.integration.events.isolation import CrossingSearch
from varint.integration.events.native_crossings import LoopIn, crossings_by
from varint.results.records import Event
from varint.results.trajectory import Trajectory

# steps that are searched at first, then times as many as there were before: all zeros among them
# are located
FEWEST, GROWTH = 32, 8


def find_first(
    kernel: Kernel | None,
    search: CrossingSearch,
    motion: Trajectory,
    impacts: Mapping[int, Event],
    before: int,
    loop_in: LoopIn | None = None,
) -> Crossings:
    """`crossings_by`, as far as the first nodes that have any; `before` them the run had so many
    steps without one.
    """
    begin, last = 0, len(motion) - 1
    while True:
        end = min(begin + max(FEWEST, GROWTH * (before + begin)), last)
        here = {i - begin: impact for i, impact in impacts.items() if begin < i <= end}
        part = motion if (begin, end) == (0, last) else motion[begin : end + 1]
        found = crossings_by(kernel, search, part, here, loop_in)
        if len(found.jump) or end == last:
            break
        begin = end
    before_it, after_it = (x._replace(node=x.node + begin) for x in (found.before, found.after))
    return Crossings(before_it, after_it, found.jump)
