"""Whether steps of a scene may end at its switches, by which rules, and the pieces of a run."""

from __future__ import annotations

from functools import partial

from varint.integration.events.crossings import Watch
from varint.integration.plan import default_rule
from varint.integration.problem import InitialValueProblem, RunOptions
from varint.integration.switches.branch import slidable, slope_size
from varint.integration.switches.course import Course, Piece
from varint.integration.switches.follow import follow
from varint.integration.switches.frozen import frozen_scene
from varint.integration.switches.watching import cut_among
from varint.rules.rule import Rule, gauss, lobatto
from varint.scene.system import System

STAGES, NODES = (2, 4, 6, 8), (3, 5, 7)
# operations of the slopes of what holds, beyond which a loop of many unknowns takes long to write
LARGE = 1000


def possible(
    system: System, rule: Rule | None, problem: InitialValueProblem, options: RunOptions
) -> bool:
    """Whether steps may end at switches, as far as the scene and what is asked tell."""
    if frozen_scene(system) is None:
        return False
    made, known = (lobatto if _held(system) else gauss), list(rules_for(system))
    if not system.structure.nonholonomic:
        known = [made(k) for k in range(2 if made is lobatto else 1, 9)]
    rows = () if problem.active_set is None else problem.active_set.rows
    return (
        not (system.structure.contacts and system.structure.nonholonomic)
        and len(rows) == system.structure.constraints
        and (rule is None or rule in known)
        and options.backend != "interpreted"
    )


def _held(system: System) -> bool:
    """Whether constraints hold the motion, or contacts may."""
    return bool(system.structure.constraints or system.structure.contacts)


def rules_for(system: System) -> dict[Rule, float]:
    """Rules that the pieces may be stepped by, with the work of a step."""
    if system.structure.nonholonomic:
        return {default_rule(system): 1.0}
    if _held(system):
        few = max((slope_size(system, j) for j in slidable(system)), default=0) > LARGE
        return {lobatto(k): (k - 1) ** 1.5 for k in (NODES[:1] if few else NODES)}
    return {gauss(k): 5.0 * k / min(k, 4) for k in STAGES}


def run_pieces(course: Course, parts: int, stop: Watch | None) -> list[Piece] | None:
    """The pieces until the end or the stop; None where the motion cannot be followed so."""
    pieces: list[Piece] = []
    end = course.problem.t0 + course.problem.h
    course.reached = course.left = 0.0
    for some in follow(course, parts):
        if some is None:
            return None
        t = float(some[-1].t[-1])
        course.reached = abs(t - course.problem.t0)
        course.say(partial("{} steps a unit of time, t = {:.4g} of {:.4g}".format, parts, t, end))
        cut = cut_among(course, pieces[-1:], some, stop) if stop else None
        pieces += some if cut is None else cut
        if cut is not None:
            break
    return pieces
