"""Steps that are shorter where forces bend sharply, and nowhere else: smoothed friction, v |v|.

Where a force turns over within a small speed, steps as short as that takes are needed for the short
time in which the speed passes, and equal ones are as short all the time: v/√(v² + ε²) and tanh(v/ε)
took up to millions. Where three runs with more and more steps show a low order although they are
close, or do not come to their ends, the steps of the next one are fitted. Pairs of equal steps are
halved, and the halves again, until the two highest Legendre coefficients of the force, along the
motion that the last run shows, are small in each: `bent_steps` says what they tell. Steps that
are not solved are halved alike. A run whose own nodes show more than what is wanted is fitted once
more, since the place of a bend was not known before; two to five runs find it.

What proves the error are runs of 3/2 and 2 times as many steps in the same stretches, as where
steps grow (`graded_steps`): halving pairs makes sizes powers of two of one another, and a pair of
each size is divided by 3/2. Steps begin anew at each change of size.

Forces may bend between the end of a step and the first look at it, where a motion begins at rest,
say: what the polynomial through all looks misses at both ends counts as an impulse over that part.
Or a speed comes close to a bend and turns back, as on a belt that sticks and slips: long steps of
the second fitted run are looked at in parts, and fitted once more where these bend. Of 1,614 random
calls one had erred silently before that.

Steps stay equal with events, an end that is looked for or nodes that are left out, and where fitted
ones are too many or do not prove the error: friction that holds for long is one, whose momenta no
long step damps.
"""

LOW = 5.0  # order that three runs have shown: a smooth motion has the rule's
CLEAR = 0.1  # difference of runs which are too coarse to tell of an order
WORTH = 300.0  # steps that third order asks for, and more repay fitted ones
LEAST_RUNS = 3  # the third one that does not come to its end is fitted, too
BASE = 4.0  # times the steps of the first run: pairs of more are not begun with
AIMED = 0.1  # of what is wanted: impulse of bends in each step
PASSABLE = 1.0  # of what is wanted: impulse of bends in all steps of a run
HALVED = 2  # times: steps halved less often are long
PARTS = 4  # of long steps
# times the steps of an equal run in the low gear: as many in the high one, for the same motions
FARTHER = 4
