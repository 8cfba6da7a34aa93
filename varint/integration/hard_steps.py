"""Steps whose solution hangs on the way to it.

Where steps are long for a motion (hω above 3 or so, and not linear) their equations have several
solutions, or none, and Newton's method wanders before it comes to one of them: which, is decided by
the last bit. A loop that adds up in another order finds another one, and the runs part. Native and
compiled loops have the same bits; an interpreted run that meets such a step is done from its start
by the loop that was built with the package, so that all answer alike.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from varint.integration.state import NodeBlock, RunState
from varint.integration.trajectories import Run, moving_system
from varint.rules.rule import Rule
from varint.scene.system import System

if TYPE_CHECKING:
    from varint.codegen.kernel import Kernel

# iterations of Newton's method in a step that resolves the motion: 2 to 4, more in the first, which
# begins with a constant velocity
FEW, FIRST = 4, 6


class HardStep(Exception):
    """A run has met a step whose solution hangs on the way to it."""

    def __init__(self, kernel: Kernel) -> None:
        super().__init__()
        self.kernel = kernel


def until_hard(run: Run) -> Run:
    """A run whose blocks, where they are interpreted, end with a step that is hard to solve.

    Raises
    ------
    HardStep
        There, where the scene has a loop that needs no compiler; it should do the whole run.
    """
    scene = moving_system(run)
    if run.kernel is not None or scene is not run.system or scene.structure.contacts:
        return run
    return run._replace(blocks=_until_hard(run, scene))


def _until_hard(run: Run, scene: System) -> Iterator[NodeBlock]:
    rule, every = run.plan.rule, run.problem.save_every
    for block in run.blocks:
        if is_hard(block, every) and (kernel := _native_or_none(scene, rule)):
            raise HardStep(kernel)
        yield block


def loop_that_took_over(at: RunState | None, system: System, rule: Rule) -> Kernel | None:
    """The loop that did an interpreted run which is taken up again at a position, if one took
    over.
    """
    if at is None or (at.carry is None and not at.by_newton):
        return None
    return _native_or_none(system, rule)


def is_hard(block: NodeBlock, every: int) -> bool:
    """Whether a step of an interpreted block failed once, or took many iterations; of steps between
    saved nodes their mean is known.
    """
    failed = block.good < len(block.k) or (block.after is not None and block.after.largest <= 1)
    if failed or block.counts is None or not len(block.k):  # none within a long interval
        return failed
    each = np.diff(block.counts, prepend=0)
    each[0] -= (FIRST - FEW) * bool(block.k[0] == every)
    return bool(each.max() > FEW * every)


def _native_or_none(system: System, rule: Rule) -> Kernel | None:
    from varint.codegen.cache import CompileError
    from varint.codegen.graph import NotCompilable
    from varint.integration.compiled_loop import native_kernel

    try:
        return native_kernel(system, rule)
    except (NotCompilable, CompileError):
        return None
