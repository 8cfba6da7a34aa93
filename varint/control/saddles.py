"""Solutions that are no minima: where the solver's last steps were taken by a changed Hessian the
second-order test is made unasked.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence

from varint.results.trajectory import Trajectory

LAST = 3  # iterations: a strict minimum needs no regularisation near the solution
SEEN = 1e-4  # of the cost: less curvature is nearly flat, and may be the rule's own


def warn_of_saddle(found: Sequence[Trajectory], stacklevel: int) -> None:
    """A warning where a solution is a saddle. The test takes as long as a solve: it is made where
    Ipopt has met negative curvature to the end.
    """
    solution = found[0].solution
    last = solution.history.get("regularisation", [])[-LAST:]
    if len(last) < LAST or min(last) <= 0 or not solution.success:
        return
    from varint.control.second_order import SADDLE

    tested = solution.second_order
    if tested.kind == SADDLE and -tested.curvature > SEEN * abs(solution.total_cost):
        warnings.warn(
            f"the solution (cost {solution.total_cost:.6g}) is a {tested}; paths beside it cost "
            "less. Give guess= a path on one side, or take multistart, which tries many",
            stacklevel=stacklevel + 1,
        )
