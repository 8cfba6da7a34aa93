"""How exactly the equations of a step are solved."""

from __future__ import annotations

RESIDUAL_LIMIT = 1e-10  # relative to the momenta; converged steps have 1e-16 to 1e-13
# Newton's corrections are quadratic: one of 1e-9 (relative), applied, leaves an error at the
# round-off level.
LAST_CORRECTION = 1e-9
# With a matrix that is only near the derivative a correction leaves a tenth of itself or less.
LAST_FROZEN_CORRECTION = 1e-12
# A linear solve leaves 1e-14 or so of what it corrects: of this much of the unknowns less than
# round-off.
LAST_LINEAR_CORRECTION = 1e-2
