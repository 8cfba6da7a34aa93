"""Runs of linear scenes whose fastest parts are dampers, which are over at once: the steps that
resolve them are many, but any number of them is one map, by squaring the map of a step.

So there are no runs to be compared: steps are short for all that there is, and what the estimate
tells is round-off. Nodes are far apart; between them the motion is found by powers of the same map
(varint/results/dense_output.py).
"""

from __future__ import annotations

import math
from time import perf_counter
from typing import Any

import numpy as np

from varint.discrete.linear_flow import Powers, flow, has_powers, powers, rates, rough_rates
from varint.integration.choice import Choice
from varint.integration.energy_check import GOLDEN
from varint.integration.error_scale import below_largest, error_scales, scales_of_nodes
from varint.integration.linear_run import MAPPED, TOLD
from varint.integration.many_steps import steps_again
from varint.integration.plan import plan
from varint.integration.problem import InitialValueProblem
from varint.integration.trajectories import stats_of
from varint.integration.two_runs import CHANCE, FLOOR, shows_its_error
from varint.numerics.limits import TICK
from varint.numerics.linear_maps import exactly_moved, moved, spread
from varint.results.trajectory import Trajectory
from varint.scene.memory import per_scene
from varint.scene.system import System

# radians, or times that something falls to 1/e, of the fastest motion and of what dampers stop:
# over many more steps than that loops take long, and so much is over in a hundredth of the time
LONG = 2.0**14, 2.0**12
# the same where a map cannot be repeated as often as the steps are many, for its round-off
SHORT = 2.0**8, 2.0**8
NUMBERS = 2**20  # of all nodes together at most
MOST_NODES = 2**14
LEAST_SQUARES = 8
MOST_SQUARES = 48  # beyond, steps are hardly longer than the last digit of times
SAMPLES = 64  # numbers of steps at which round-off is looked at


@per_scene
def settles(system: System) -> bool:
    """Whether dampers of a linear scene that nothing drives may ask for very many steps."""
    damped = system.structure.force_on_velocity and not shows_its_error(system)
    return damped and has_powers(system, MAPPED)


def settles_within(
    system: System, c: np.ndarray, duration: float, least: tuple[float, float] = LONG
) -> bool:
    """Whether that is so within this time, with these parameters."""
    if not settles(system):
        return False
    time, (many, over) = abs(duration), least
    fastest, decay = rough_rates(system, c)
    if fastest * time <= many or decay * time <= over:
        return False
    fastest, decay = rates(system, c)
    return fastest * time > many and decay * time > over


@np.errstate(all="ignore")  # of motions that grow beyond all numbers
def by_powers(
    system: System, start: InitialValueProblem, tol: float, scale: Any, began: float
) -> Choice | None:
    """The run, where its error is below tol; None where it is not, or there are no such maps."""
    found, duration, n = flow(system, start.c), start.h * start.steps, system.structure.n
    if found is None:
        return None
    squares = max(math.ceil(math.log2(abs(duration) * found.norm)), LEAST_SQUARES)
    nodes = min(int(math.log2(min(NUMBERS // (2 * n), MOST_NODES))), squares)
    steps, every, late = 2**squares, 2 ** (squares - nodes), max(abs(start.t0), abs(duration))
    if squares > MOST_SQUARES or abs(duration) / steps < TICK * (late + abs(duration)):
        return None
    map_of = powers(system, MAPPED, start.c, duration / steps)
    finer = powers(system, MAPPED, start.c, duration / steps / 2)
    if map_of is None or finer is None:
        return None
    changes, one = map_of.up_to(squares + 1), map_of.within(start.q0[None], start.p0[None])
    x = np.concatenate((spread(changes[squares - nodes : -1], one[0]), one))
    x[-1:] += one @ changes[-1].high.T
    if not np.isfinite(x).all():
        return None
    q, p = map_of.states(x)
    q[0], p[0] = start.q0, start.p0
    k = every * np.arange(len(q))
    told = {"backend": TOLD, "seconds": perf_counter() - began}
    motion = Trajectory(
        system=system,
        rule=MAPPED,
        t=start.t0 + duration / steps * k,
        q=q,
        p=p,
        h=duration / steps,
        k=k,
        u=np.empty((steps, 1, 0)),
        c=start.c,
        functions=steps_again(MAPPED),
        stats=stats_of(plan(system, MAPPED), None, steps, (0, 0.0), told),
        origin=start.t0,
    )
    off, seen = rounded(map_of, finer, x, squares)
    places = np.concatenate((q, seen))  # those of what is over before the first node, too
    if scale is None:
        scales = scales_of_nodes(system, places, np.zeros(n), motion.t[:1], start.c)
        scales = below_largest(scales, places)
    else:
        scales = error_scales(system, motion, scale)
    size = float((np.abs(places).max(axis=0) / scales).max())
    estimate = max(CHANCE * float((off / scales).max()), FLOOR * size)
    if not estimate <= tol:
        return None
    return Choice(MAPPED, steps, motion, estimate, 1, True, True)


def rounded(
    map_of: Powers, finer: Powers, x: np.ndarray, squares: int
) -> tuple[np.ndarray, np.ndarray]:
    """How far coordinates (n,) are off, and what they are after some numbers of steps (N, n): nodes
    x, in units, and what is found from them are compared with the same with twice the digits, and
    this with that by steps of half the length, whose maps are others.
    """
    low = squares - (len(x) - 1).bit_length() + 1
    even = (np.arange(SAMPLES) * GOLDEN % 1 * 2**squares).astype(np.int64)
    k = np.concatenate((2 ** np.arange(squares + 1), even))
    changes, one = map_of.up_to(squares + 1), np.repeat(x[:1], len(k), axis=0)
    found = moved(changes[:low], x[k >> low], k & ((1 << low) - 1))
    exact = exactly_moved(changes, one, k)
    other = exactly_moved(finer.up_to(squares + 2), one, 2 * k)
    off = np.maximum(np.abs(found - exact), np.abs(other - exact)).max(axis=0)
    n = len(off) // 2
    return off[:n] * map_of.unit[:n], map_of.states(exact)[0]
