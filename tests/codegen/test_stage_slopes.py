"""Steps whose iteration contracts poorly: slopes of one point make it simplified Newton steps."""

import casadi as ca
import numpy as np
import pytest
from scenes import damped_beam, resting_chain
from test_compiled import controls, simulated

import varint as vi
from varint.codegen.arguments import DONE
from varint.codegen.cache import compiler
from varint.codegen.gauss import gauss_kernel
from varint.codegen.native import native_gauss
from varint.codegen.newton import newton_kernel
from varint.codegen.tableau import gauss_tableau

pytestmark = pytest.mark.skipif(compiler() is None, reason="no C compiler")


def arm(stiffness: float = 100.0, damping: float = 20.0, control: bool = False) -> vi.System:
    """Two links that a stiff controller holds: its fastest motions die out within milliseconds."""
    q, v = vi.coordinates("a", "b")
    u = ca.SX.sym("u", 2) if control else None
    speed = v[0] ** 2 / 2 + 0.4 * (v[0] ** 2 + 0.49 * (v[0] + v[1]) ** 2)
    kinetic = speed + 0.56 * v[0] * (v[0] + v[1]) * ca.cos(q[1])
    height = 1.8 * ca.sin(q[0]) + 0.56 * ca.sin(q[0] + q[1])
    push = -stiffness * (q - ca.DM([0.5, 0.3])) - damping * v
    if u is not None:
        return vi.System(q, v, kinetic - 9.81 * height, force=push + u, control=u)
    return vi.System(q, v, kinetic - 9.81 * height, force=push)


def damped_spring() -> vi.System:
    q, v = vi.coordinates("x", "y")
    energy = 40 * ca.sumsqr(q) + 0.3 * q[0] ** 2 * q[1]
    return vi.System(q, v, ca.sumsqr(v) / 2 - energy, force=-30 * v - 5 * ca.tanh(v))


def stiff_chain() -> vi.System:
    return vi.models.fpu_chain(omega=50.0).system


def turned_by_a_field() -> vi.System:
    q, v = vi.coordinates("x", "y", "z")
    potential = ca.vertcat(-q[1], q[0], 0) * (8 + 0.1 * q[2] ** 2)
    return vi.System(q, v, ca.sumsqr(v) / 2 + ca.dot(potential, v) - ca.sumsqr(q) / 2)


def damped_line(many: int = 20) -> vi.System:
    q, v = vi.coordinates(*[f"x{i}" for i in range(many)])
    bends, rates = q - ca.vertcat(0, q[:-1]), v - ca.vertcat(0, v[:-1])
    damping = 40 * (rates - ca.vertcat(rates[1:], 0))
    energy = 200 * ca.sumsqr(bends) + 20 * ca.sum1(bends**4)
    return vi.System(q, v, ca.sumsqr(v) / 2 - energy, force=-damping)


# scene, stages, start, momenta, h: fixed-point iteration alone diverges there, or nearly so
STIFF = {
    "velocities and forces": (arm, 8, [0.0, 0.0], [0.0, 0.0], 0.06),
    "the same with controls": (lambda: arm(control=True), 6, [0.0, 0.0], [0.0, 0.0], 0.1),
    "accelerations, by speeds": (damped_spring, 4, [1.0, 0.5], [0.0, 2.0], 0.2),
    "accelerations": (stiff_chain, 4, [1.0, 0, 0, 0.02, 0, 0], [1.0, 0, 0, 1.0, 0, 0], 0.1),
    "twenty unknowns": (damped_beam, 8, [0.0] * 10, [0.0] * 10, 0.01),
    "twenty accelerations": (damped_line, 6, [0.05 * i for i in range(20)], [0.0] * 20, 0.04),
    "a field": (turned_by_a_field, 8, [0.3, 0.0, 0.1], [0.5, 1.0, 0.2], 0.3),
}


BOTH = native_gauss, gauss_kernel


def runs_by(which, steps, *kernels):
    """The scene, its start and controls, and its runs by kernels of a scene and a rule."""
    make, stages, *start = STIFF[which]
    system, rule = make(), vi.gauss(stages)
    made = [kernel(system, rule) for kernel in kernels]
    u = controls(made[0], steps) if made[0].controls else None
    found = [simulated(k, *start, steps, system, u=u) for k in made]
    assert all(run.status == DONE for run in found)
    return (system, start, u, made), *found


@pytest.mark.parametrize("which", STIFF)
def test_slopes_lead_to_the_stages_that_newtons_method_finds(which):
    _, one, other = runs_by(which, 20, gauss_kernel, newton_kernel)
    size = np.abs(other.rows).max(axis=0)
    assert (np.abs(one.rows - other.rows) / size).max() < 1e-11


def test_slopes_are_taken_where_the_step_begins_however_far_unknowns_have_gone_off():
    """Beside a motion of strong dampers some fresh steps went on from unknowns of 1e7, by whose
    size slopes were taken: of 3000 places 37 were off by up to 7e-5.
    """
    q, v = vi.coordinates("a", "b")
    height = -1.908 * 2.034 * ca.cos(q[0]) - 1.593 * 1.174 * ca.cos(q[0] + q[1])
    ends = 1.908 * v[0], 1.174 * (v[0] + v[1])
    kinetic = 0.2205 * ends[0] ** 2 + 0.7965 * (ends[0] ** 2 + ends[1] ** 2)
    kinetic += 1.593 * ends[0] * ends[1] * ca.cos(q[1])
    force = ca.vertcat(-27.614 * v[0], -216.07 * v[1] - 268.1 * (q[1] + 0.2418))
    system = vi.System(q, v, kinetic - 9.81 * height, force=force)
    start = dict(q0=[0.38, 1.67], v0=[0.0, 0.0], h=0.0223, steps=120)
    times = np.linspace(0, 120 * 0.0223, 3001)
    motion = vi.simulate(system, vi.gauss(8), **start)
    other = vi.simulate(system, vi.gauss(8), **start, backend="interpreted")
    assert np.abs(motion.at(times).q - other.at(times).q).max() < 1e-11


@pytest.mark.parametrize("which", STIFF)
def test_with_slopes_too_data_have_the_bytes_of_code_and_pieces_those_of_the_whole(which):
    (system, start, u, (tape, code)), one, other = runs_by(which, 60, native_gauss, gauss_kernel)
    assert one.rows.tobytes() == other.rows.tobytes()
    assert one.carry.tobytes() == other.carry.tobytes()
    assert one.iterations == other.iterations
    carry = None
    for first, kernel in ((0, tape), (15, code), (30, code), (45, tape)):
        options = {"u": None if u is None else u[first : first + 15], "first": first}
        piece = simulated(kernel, *start, 15, system, carry=carry, **options)
        carry = piece.carry
        assert piece.rows[-1].tobytes() == one.rows[first + 15].tobytes()


def test_a_stiff_step_takes_few_evaluations():
    """ω h = 5, and a rate of damping times h of 13: alone the iteration diverges."""
    for which in ("velocities and forces", "accelerations, by speeds", "accelerations"):
        _, run = runs_by(which, 300, gauss_kernel)
        assert run.iterations < 15 * 300


# a part of h, and evaluations of a fresh step: sixty do not do, or hardly, which a few show
SLOW = {
    "velocities and forces": (0.3, 40),
    "accelerations, by speeds": (0.5, 35),
    "accelerations": (0.8, 30),
}


@pytest.mark.parametrize("which", SLOW)
def test_a_fresh_step_that_contracts_too_slowly_goes_on_with_slopes(which):
    """All sixty evaluations were made, and others after them: 57, 57 and 50 in all."""
    make, stages, *start, h = STIFF[which]
    system, rule, (part, most) = make(), vi.gauss(stages), SLOW[which]
    one, other, by_newton = (
        simulated(kernel(system, rule), *start, part * h, 1, system)
        for kernel in (native_gauss, gauss_kernel, newton_kernel)
    )
    assert one.status == DONE
    assert one.iterations < most
    assert one.rows.tobytes() == other.rows.tobytes()
    assert one.iterations == other.iterations
    assert np.abs(one.rows - by_newton.rows).max() < 1e-13 * np.abs(by_newton.rows).max()


def test_a_step_that_was_begun_without_slopes_counts_with_them_alone():
    """Evaluations of a step that was begun beside the one before counted as those that one with
    slopes takes: the next one was not looked at before as many, and slopes seemed of no use.
    """
    q, v = vi.coordinates("x", "y", "z")
    well = (2 * q[2] ** 2 - q[0] ** 2 - q[1] ** 2) / 2 + 0.02 * q[2] ** 4
    turned = 5 * ca.vertcat(v[1], -v[0], 0)
    system = vi.System(q, v, ca.sumsqr(v) / 2 - well, force=turned)
    start = [1.0, 0.0, 0.5], [0.0, 0.4, 0.1], 40 / 98
    one, other = (simulated(k(system, vi.gauss(8)), *start, 98, system) for k in BOTH)
    assert one.iterations == other.iterations < 5 * 98
    assert one.rows.tobytes() == other.rows.tobytes()


def test_slopes_do_not_lead_to_another_solution_of_long_steps():
    """The equations of a step that is too long have several; a growing force and a potential that
    falls off let them lie near. Slopes from unknowns that were still far off led to another one.
    """
    q, v = vi.coordinates("x", "s")
    lagrangian = ca.sumsqr(v) / 2 + (q[1] - 1) * q[0] ** 2 / 2 - q[0] ** 4 / 4
    force = ca.vertcat(1e-6 - 0.8 * v[0], 0.391 - 5 * v[1])
    system = vi.System(q, v, lagrangian, force=force)
    start = dict(q0=[-0.14, 0.444], v0=[0.0, 0.0])
    exact = vi.simulate(system, vi.gauss(8), **start, h=150.0 / 6000, steps=6000)
    for steps in (48, 96, 384):
        motion = vi.simulate(system, vi.gauss(8), **start, h=150.0 / steps, steps=steps)
        assert np.abs(motion.q[-1] / exact.q[-1] - 1).max() < 1e-8


def test_an_arm_that_is_held_stiffly_takes_no_more_steps_than_its_first_moments_ask_for():
    """Thousands were needed for the iteration to contract, hundreds resolve the transient."""
    for tol, most in ((1e-3, 600), (1e-6, 800)):
        motion = vi.simulate(arm(), q0=[0.0, 0.0], v0=[0.0, 0.0], duration=10.0, tol=tol)
        assert motion.stats["steps"] < most
        rest = vi.simulate(arm(), q0=motion.q[-1], v0=[0.0, 0.0], duration=1.0, tol=1e-9)
        assert np.abs(rest.q - motion.q[-1]).max() < tol


@pytest.mark.parametrize("stages", (2, 4, 6, 8))
def test_the_modes_of_the_rule_are_those_of_its_matrix(stages):
    """b A b⁻¹ = back · (the eigenvalues, pair by pair) · to, to the digits that are kept."""
    table, rule = gauss_tableau(stages), vi.gauss(stages)
    half, b = stages // 2, np.array(rule.weights)
    re, im = (np.diag(table[name][0, :half]) for name in ("MODE_RE", "MODE_IM"))
    pairs = np.block([[re, -im], [im, re]])
    found = table["STAGE_OF_MODES"] @ pairs @ table["STAGE_MODES"]
    wanted = b[:, None] * np.array(rule.collocation, float) / b
    assert np.abs(found - wanted).max() < 1e-6
    assert np.abs(table["STAGE_OF_MODES"] @ table["STAGE_MODES"] - np.eye(stages)).max() < 1e-6


@pytest.mark.parametrize("steps", (500, 2000))
def test_what_has_come_to_rest_is_stepped_without_another_method(steps):
    """Slopes were taken by sizes that had become round-off, and its last digits were not told from
    changes: 2,000 steps took four seconds, most of them by Newton's method.
    """
    system, rule, still = resting_chain(), vi.gauss(8), [0.0] * 9
    one, other = (simulated(k(system, rule), still, still, 20 / steps, steps, system) for k in BOTH)
    assert one.status == DONE
    assert one.rows.tobytes() == other.rows.tobytes()
    assert one.iterations == other.iterations < 10 * steps
    there, springs = one.rows[-1, 0], np.linspace(-0.8, 0.8, 9)
    assert np.abs(there - springs).max() < 0.05
