"""What a step costs, from the number of its operations alone: when to compile, and when to look at
an interpreted run.

Typical sizes are renewed where a run is looked at, so the blocks show in the last digits: they
follow from the scene and the rule alone, not from the clock, and the same run always has the same.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.codegen.cache import has_instructions
from varint.codegen.driven import FEW_COORDINATES
from varint.codegen.mechanics import force
from varint.discrete.composed import base_of, shares
from varint.discrete.lagrangian import point_function
from varint.discrete.legendre import known_velocity
from varint.discrete.shake_equations import eliminates_path, hidden_functions, shake_equations
from varint.numerics.limits import CLOSED
from varint.rules.polynomials import MOST_STAGES
from varint.rules.rule import Rule, gauss
from varint.scene.memory import per_scene
from varint.scene.system import System

PATIENCE = 0.2  # seconds that Ctrl-C, the progress bar and checkpoints wait
MOST_STEPS = 10_000
INSTRUCTION = 4e-9  # seconds of CasADi's virtual machine for one operation
# evaluations of every stage in an implicit step, derivatives included: those of n coordinates cost
# more, but hardly more than those of MANY, for not all are coupled with all
EVALUATIONS, EVALUATIONS_EACH, MANY = 24, 8, 6
FACTOR = 9e-9  # seconds of it for an operation of a factorisation
UNKNOWN = 4e-6  # seconds of it for an unknown of Newton's method, from SEVERAL on
SEVERAL = 8
CALL = 3e-7  # seconds of it for a step besides
# of the estimate of an implicit step, in the long run, and of one with constraints
SHARE, HELD_SHARE = 0.5, 0.3
# Seconds of the processor until a kernel can run, and for a statement of it: a fifth to arrange and
# write it, the rest in C. Functions are written in parts: it does not grow with their length. The
# loop, which is compiled once for all scenes of a size, is there already. Of 20 scenes by Newton's
# method, 200 to 5,500 statements, 0.1 to 0.7 seconds, what is predicted is 0.8 to 1.7 times that.
STARTING, STATEMENT = 0.06, 8.5e-5  # Newton's method
# where long functions are instructions: of 20 scenes, 0.07 to 0.4 seconds, what is predicted is 0.7
# to 1.6 times that
INSTRUCTED_STATEMENT = 9e-6
EXPLICIT_STARTING, EXPLICIT_STATEMENT = 0.1, 4e-5
# fixed points of all stages
STAGES_STARTING, STAGES_STATEMENT = 0.12, 4.5e-5
FIRST_ORDER, COUPLED_STATEMENT = 0.02, 1.5e-4  # where velocities are unknowns of the stages, too
TREE_STATEMENT = 1.1e-4  # of those of a tree of links: its inertias and velocities are more of it
# seconds that such a loop takes, of 20 sizes 0.22 to 0.35, with constraints 0.41 to 0.57
LOOP, HELD_LOOP = 0.28, 0.47
BUILDING = 1e-4  # seconds to build an implicit step for CasADi, an operation at a node
ROLLING = 2.5e-7  # seconds to build the loop around a step, a step of it and a number of the state
RESCUE = 0.5  # seconds that a trial which fails may take interpreted
# operations of slopes at pairs of stages beyond which arranging them takes long, or longer than
# what is interpreted; a number of their own counts as so many, for no two stages share it
SOLVED, ARRANGED, NUMBER = 12_000, 40_000, 3
QUICK = 1.0  # seconds that compiling may always take once a compiled run needs Newton's method
RIGHT_SIDE = 4  # statements in a right-hand side for an operation of L, ∂L/∂q and ∂L/∂v
SECOND = 7  # and in second derivatives, as Newton's method needs them
NEWTON = 12  # and in all that Newton's method needs without constraints, or with few unknowns
ENTRY = 4  # statements for an entry of a matrix that is written out
WRITTEN = 2  # nodes and control points, with constraints: of more, a loop has what is long


@per_scene
def steps_at_once(system: System, rule: Rule) -> int:
    """Steps of a block at most, a power of ten: what takes about `PATIENCE`."""
    most, cost = MOST_STEPS, interpreted_seconds(system, rule)
    while most > 1 and most * cost > PATIENCE:
        most //= 10
    return most


def repays(system: System, rule: Rule, steps: int) -> bool:
    """Whether so many interpreted steps take longer than the compiler is predicted to take, what
    has to be built for either counted in.
    """
    s = system.structure
    if not (rule.kicks and s.explicit) and (
        s.contacts or not s.quadratic_kinetic or not (rule.points or base_of(system, rule))
    ):
        return False
    interpreted = interpreted_run_seconds(system, rule, steps)
    if interpreted < EXPLICIT_STARTING:
        return False
    loop = loop_seconds(system) if _by_newton(system, rule) else 0.0  # it may not be there
    return interpreted > compiling_seconds(system, rule) + loop


def interpreted_run_seconds(system: System, rule: Rule, steps: int) -> float:
    """An estimate of the time of an interpreted run, the building of its step and of the loops
    around it counted in.
    """
    s = system.structure
    rolled = min(steps, steps_at_once(system, rule)) * (4 + max(rule.degree, 1)) * s.n * ROLLING
    once = interpreted_seconds(system, rule)
    if rule.kicks and s.explicit:
        return rolled + once * steps
    share = HELD_SHARE if s.constraints or s.nonholonomic else SHARE
    return _built_in(system, rule) + rolled + share * once * steps


def _built_in(system: System, rule: Rule) -> float:
    """An estimate of the seconds in which CasADi builds an implicit step."""
    return BUILDING * point_function(system).n_instructions() * len(rule.nodes)


@per_scene
def compiling_seconds(system: System, rule: Rule) -> float:
    """An estimate of the time that generating and compiling a scene's part of the loop takes, from
    the sizes of the expressions.
    """
    if base := base_of(system, rule):
        return compiling_seconds(system, base)
    s, statements = system.structure, _statements(system, rule)
    if rule.kicks and s.explicit:
        return EXPLICIT_STARTING + EXPLICIT_STATEMENT * statements
    if _by_newton(system, rule):
        inside = s.n * max(rule.degree - 1, 1)
        closed = inside <= CLOSED and not (s.constraints or s.nonholonomic)
        apart = has_instructions() and not closed
        return STARTING + (INSTRUCTED_STATEMENT if apart else STATEMENT) * statements
    if s.separable and s.constant_mass:
        return STAGES_STARTING + STAGES_STATEMENT * statements
    tree = known_velocity(system, system.v) is not None
    each = TREE_STATEMENT if tree else COUPLED_STATEMENT
    return STAGES_STARTING + FIRST_ORDER + each * statements


def loop_seconds(system: System) -> float:
    """An estimate of the time that compiling the other part takes, where it is not in the cache."""
    return HELD_LOOP if system.structure.constraints or system.structure.nonholonomic else LOOP


def newton_repays(system: System, rule: Rule, steps: int) -> bool:
    """Whether compiling Newton's method, to which an iteration that does not contract is handed, is
    quick or takes less than so many interpreted steps.
    """
    point = point_function(system).n_instructions()
    statement = INSTRUCTED_STATEMENT if has_instructions() else STATEMENT
    seconds = STARTING + statement * NEWTON * point + LOOP
    return seconds < QUICK or interpreted_seconds(system, rule) * steps > seconds


def _statements(system: System, rule: Rule) -> int:
    s, point = system.structure, point_function(system).n_instructions()
    if not (s.constraints or s.nonholonomic):
        return (RIGHT_SIDE if _by_right_sides(system, rule) else NEWTON) * point
    if s.constraints and eliminates_path(system, rule):
        hidden = hidden_functions(system)[0]
        gaps = shake_equations(system).left
        both = ca.jacobian_sparsity(gaps, shake_equations(system).y).nnz() + hidden.nnz_out(0)
        return NEWTON * point + hidden.n_instructions() + ENTRY * both
    rows = ca.jacobian_sparsity(
        ca.vertcat(system.constraint, system.nonholonomic @ system.v), system.q
    )
    coupled = _coupling(system).nnz() + 2 * rows.nnz()
    nodes, degree = min(len(rule.nodes), WRITTEN), min(max(rule.degree, 1), WRITTEN)
    return SECOND * point * nodes + ENTRY * coupled * degree**2


def _by_newton(system: System, rule: Rule) -> bool:
    """Whether the compiled loop is one of Newton's method, or of a map of a linear scene."""
    s = system.structure
    if rule.kicks and s.explicit:
        return False
    solved = is_solved_at_once(system, rule)
    return bool(s.constraints or s.nonholonomic or solved or not _by_right_sides(system, rule))


def _by_right_sides(system: System, rule: Rule) -> bool:
    """Whether the compiled loop needs no derivatives of a step's equations, or constant ones."""
    s, stages = system.structure, len(rule.nodes)
    if s.linear or (rule.kicks and s.explicit):
        return True
    return s.quadratic_kinetic and rule == gauss(min(stages, MOST_STAGES))


def rescues(system: System, rule: Rule, steps: int) -> bool:
    """Whether a trial of so many steps that fails is made interpreted, for that is soon over."""
    return _built_in(system, rule) + interpreted_seconds(system, rule) * steps <= RESCUE


def is_solved_at_once(system: System, rule: Rule, most: int = SOLVED) -> bool:
    """Whether steps of a linear scene are one solve each, whose matrix is no long list of
    operations.
    """
    s = system.structure
    if not s.linear or s.n <= FEW_COORDINATES:
        return s.linear
    return _operations_of_slopes(system) * len(rule.nodes) ** 2 <= most


@per_scene
def _operations_of_slopes(system: System) -> int:
    s, state = system, ca.vertcat(system.q, system.v)
    slopes = [ca.jacobian(x, state) for x in (force(s), s.momentum)]
    f = ca.Function("slopes", [s.q, s.v, s.t, s.control, s.c], slopes)
    count = f.n_instructions()
    return int(count + NUMBER * sum(f.instruction_id(k) == ca.OP_CONST for k in range(count)))


@per_scene
def interpreted_seconds(system: System, rule: Rule) -> float:
    """An estimate of an interpreted step's time, right to a factor of two or too long."""
    if base := base_of(system, rule):
        return len(shares(system, rule)) * interpreted_seconds(system, base)
    s = system.structure
    evaluation = point_function(system).n_instructions() * len(rule.nodes) * INSTRUCTION
    if rule.kicks and s.explicit:
        return evaluation + CALL
    degree = max(rule.degree, 1)
    if s.constraints or s.nonholonomic:
        return max((s.n + s.constraints + s.nonholonomic) * degree * UNKNOWN, evaluation)
    evaluations = EVALUATIONS + EVALUATIONS_EACH * min(s.n, MANY)
    unknowns = s.n * degree
    rest = unknowns * UNKNOWN if unknowns >= SEVERAL else 0.0
    return evaluation * evaluations + _factorisation(system) * degree**3 * FACTOR + rest


def _factorisation(system: System) -> int:
    """Operations of an LDLᵀ factorisation of a matrix in which the coordinates are coupled as in
    the scene.
    """
    triangle = _coupling(system).ldl()[0]  # transposed, without its diagonal: columns are rows of L
    filled = np.bincount(triangle.get_triplet()[0], minlength=system.structure.n)
    return int(((1 + filled) ** 2).sum())


@per_scene
def _coupling(system: System) -> ca.Sparsity:
    """Which coordinates the equations of motion couple."""
    s = system
    slopes = [ca.jacobian_sparsity(e, x) for e in (s.momentum, force(s)) for x in (s.q, s.v)]
    pattern = ca.Sparsity.diag(s.structure.n)
    for slope in slopes:
        pattern = pattern + slope + slope.T
    return pattern
