"""Steps that are halved on the way, where a first run of equal ones does not get through.

Twice as many steps, and again, are many where a motion asks for short ones in a part of it: a
transient that is lost, friction that turns over at each standstill. After two lost runs, or the
first or second one in which forces are seen to bend sharply with velocities, a run goes on from the
start by pairs of equal steps. A pair that is not solved, in which the highest Legendre coefficients
of the unknowns are large, or along which forces bend by more than `fitted_steps` aims at, is done
once more with half the steps, and half of these; behind it steps are doubled again, up to the first
ones. Runs behind it have the same stretches with 3/2 and 2 times as many steps, and prove the error
as where steps grow (`graded_steps`). Where they do not, all begins once more with equal steps, and
`fitted_steps` may follow. It is done once: what is lost by it is less than what runs of ever more
equal steps took before.

A first run is coarse: its steps may make some hundred times of what is wanted, as one with twice
the steps makes 2⁻¹³ of that (`shown_by_stages`).
"""

LOSSES = 2  # runs that do not come to their ends
MADE = 500.0  # times what is wanted: what highest coefficients of all steps say may be made
ROUGHLY = 0.2  # of the largest unknowns: highest coefficients that tell nothing
SHARP = 10.0  # times the largest impulse of bends in a step: what a run errs by
FAINTLY = 500.0  # times less than may be bend forces in steps that are doubled
