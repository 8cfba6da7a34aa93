"""Steps that grow where a motion settles: what is damped needs long ones when it has come to rest.

The first run of scenes whose forces do not depend on time looks, every few steps, at the unknowns
of the last one: where their highest Legendre coefficients say that steps twice as long would show
the motion, those that follow are, again and again. Every further run has the same stretches, with
so many times the steps: nodes are counted and shared as those of equal steps, and the difference of
two runs proves the error as it does there. Where the motion wakes up again, or the runs do not
prove it, all steps are equal. Steps that are shorter where forces bend are those of `fitted_steps`,
in the same form.

Two things bound how long they become. In no coordinate a step goes farther than steps of the usual
size have gone before: what acts at a place alone is passed over no sooner than by equal steps. And
they still resolve the linear motion near a point of rest, whether it is stable or not: what leaves
an unstable one slowly is seen to do so. Where dampers are stiff (`damped_motions`) first steps are
for what these stop at once, and the usual size is that for what lasts; long steps that do not show
the motion are tried once more at half their size. No bound is needed for a pulse at some time,
because forces do not depend on it.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from varint.codegen.gauss import gauss_form, lanes_for
from varint.codegen.refined_runs import StageLooks
from varint.rules.rule import Rule
from varint.scene.system import System

# of the largest unknowns so far: those of a motion that settles, whose iterations go on as far as
# those of a run that is no coarse one, to be seen to be smooth
QUIET = 0.1
SMOOTH = 0.1  # of the wanted error: what steps twice as long may miss
FEWEST = 13  # steps of a first run that repays a look
TURNED = 8.0  # radians of the fastest small motion at most; e⁸ has a relative error of 5e-4


def stage_looks(system: System, rule: Rule) -> StageLooks:
    """How the core looks at the unknowns of the last step of a run by a Gauss rule."""
    stages, unknowns = len(rule.nodes), (3 - gauss_form(system)) * system.structure.n
    _, padded = lanes_for(stages)
    return StageLooks(_heights(stages, padded), (unknowns, stages, padded))


@cache
def _heights(stages: int, padded: int) -> np.ndarray:
    """What makes the two highest Legendre coefficients of values at the nodes of so many stages,
    each times its weight, and zeros behind them.
    """
    x = np.polynomial.legendre.leggauss(stages)[0]
    degrees = np.arange(stages)
    values = np.polynomial.legendre.legvander(x, stages - 1) * (2 * degrees + 1)
    return np.pad(values[:, -2:].T, ((0, 0), (0, padded - stages)))
