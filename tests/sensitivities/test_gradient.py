"""Gradients of whole runs: adjoints are the tangents' transpose, losses are integrals of the rule's
order, and nodes that were left out cost memory of the square root of their number.
"""

from __future__ import annotations

import weakref
from functools import cache
from time import monotonic

import casadi as ca
import numpy as np
import pytest
from scenes import double_pendulum, driven_damped, pendulum, slopes
from test_tangents import differences, driven_cart, named, run_of, spring, swinging

import varint as vi
from varint.sensitivities import checkpoints
from varint.sensitivities.checkpoints import schedule
from varint.sensitivities.loops import is_built, sweeper
from varint.sensitivities.start import as_text

KINDS = [
    (pendulum, vi.composition("blanes-moan4")),
    (pendulum, vi.midpoint()),
    (double_pendulum, vi.gauss(4)),
    (driven_damped, vi.gauss(2)),
    (driven_damped, vi.lobatto(3)),
    (swinging, vi.gauss(3)),
    (vi.models.pendulum_cartesian, vi.lobatto(3)),
    (vi.models.pendulum_cartesian, vi.trapezoidal()),
    (vi.models.turning_wire, vi.lobatto(2)),
    (vi.models.chaplygin_sleigh, vi.midpoint()),
]


@pytest.mark.parametrize(("scene", "rule"), KINDS, ids=named)
def test_the_adjoint_is_the_tangents_transpose(scene, rule):
    motion = run_of(scene, rule, steps=15)
    s, names = motion.system, list(motion.system.defaults)
    loss = ca.sum1(ca.sin(s.q) * (1 + s.v)) + (s.t if not s.structure.autonomous else 0)
    found = vi.gradient(motion, terminal_loss=loss)
    wanted = vi.sensitivity(motion, ["q0", "v0", "h", "t0", *names], outputs=loss)[-1, 0]
    flat = np.concatenate(
        [found.q0, found.v0, [found.h, found.t0], *(found.params[x].ravel() for x in names)]
    )
    assert found.value == pytest.approx(motion[-1:].value(loss)[0], rel=1e-14)
    assert np.abs(flat - wanted).max() < 1e-12 * np.abs(wanted).max()
    assert found.duration == pytest.approx(found.h / 15)


@pytest.mark.parametrize("rule", [vi.gauss(3), vi.composition("kahan-li6")], ids=str)
def test_compiled_and_native_gradients_are_the_same_and_interpreted_ones_agree(rule):
    system, _ = spring()
    motion = vi.simulate(system, rule, q0=[0.4, -0.3], v0=[0.2, 0.5], h=0.1, steps=30)
    loss = ca.sumsqr(system.q) + system.v[0] ** 2 * system.c[0]
    one, data, other = (
        vi.gradient(motion, loss, system.q[0], nodes=system.v[1] ** 2, backend=backend)
        for backend in ("compiled", "native", "interpreted")
    )
    assert repr(data) == repr(one)
    assert all(np.array_equal(getattr(data, name), getattr(one, name)) for name in ("q0", "v0"))
    assert one.value == pytest.approx(other.value, rel=1e-13)
    for name in ("q0", "v0", "p0", "h", "t0"):
        assert np.allclose(getattr(one, name), getattr(other, name), rtol=1e-11, atol=1e-12)
    for name, x in one.params.items():
        assert np.allclose(x, other.params[name], rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("held", [True, False], ids=["held", "at nodes"])
@pytest.mark.parametrize(
    ("rule", "backend"),
    [(vi.gauss(2), "interpreted"), (vi.gauss(3), "compiled"), (vi.lobatto(2), "compiled")],
    ids=str,
)
def test_the_gradient_by_controls_is_what_differences_of_the_loss_come_to(rule, backend, held):
    system, steps = driven_cart(), 3
    shape = (steps, 1 if held else len(rule.nodes), 2)
    loss = ca.sumsqr(system.q) * (1 + system.t) + ca.sumsqr(system.control) * system.c[0]
    start = np.random.default_rng(2).uniform(-1, 1, 2 + int(np.prod(shape)))

    def of(x: np.ndarray) -> vi.Gradient:
        u, h = x[2:].reshape(shape), 0.1 + 0.01 * x[1]
        given = dict(q0=[0.1, 0.4], v0=[0.2, -0.3], h=h, t0=x[0])
        motion = vi.simulate(system, rule, **given, steps=steps, u=u[:, 0] if held else u)
        return vi.gradient(motion, loss, backend=backend)

    found = of(start)
    flat = np.concatenate([[found.t0, 0.01 * found.h], found.u.ravel()])
    wanted = differences(lambda x: np.array([of(x).value]), start)[0]
    assert found.u.shape == shape
    assert np.abs(flat - wanted).max() < 1e-10 * np.abs(wanted).max()


@pytest.mark.parametrize("rule", [vi.gauss(2), vi.lobatto(3), vi.composition("yoshida4")], ids=str)
def test_the_running_loss_is_an_integral_of_the_rules_order(rule):
    q, v = vi.coordinates("x")
    system = vi.System(q, v, v**2 / 2 - q**2 / 2 + q**3 / 30)
    exact = vi.simulate(system, vi.gauss(8), q0=1.0, v0=0.0, duration=4.0, steps=64)
    wanted = vi.gradient(exact, q**2, backend="interpreted")
    counts, errors = [16, 32, 64], []
    for steps in counts:
        motion = vi.simulate(system, rule, q0=1.0, v0=0.0, duration=4.0, steps=steps)
        found = vi.gradient(motion, q**2, backend="interpreted")
        errors.append([abs(found.value - wanted.value), abs(found.q0[0] - wanted.q0[0])])
    assert np.abs(slopes(counts, np.array(errors), 1e-13) - rule.order).max() < 0.3


def test_a_gradient_of_an_oscillator_in_closed_form():
    q, v = vi.coordinates("x")
    motion = vi.simulate(
        vi.System(q, v, v**2 / 2 - q**2 / 2), vi.gauss(8), q0=1.5, v0=0.5, duration=2.0, steps=20
    )
    found = vi.gradient(motion, q**2)  # ∫ (a cos t + b sin t)² dt
    s, c, t = np.sin(2.0), np.cos(2.0), 2.0
    cc, cs, ss = (t + s * c) / 2, s**2 / 2, (t - s * c) / 2
    assert found.value == pytest.approx(1.5**2 * cc + 2 * 1.5 * 0.5 * cs + 0.5**2 * ss, rel=1e-13)
    assert found.q0[0] == pytest.approx(3 * cc + cs, rel=1e-12)
    assert found.v0[0] == pytest.approx(3 * cs + ss, rel=1e-12)
    assert found.duration == pytest.approx((1.5 * c + 0.5 * s) ** 2, rel=1e-12)


def test_measured_nodes_have_weights_of_their_own():
    system, _ = spring()
    motion = vi.simulate(system, vi.gauss(2), q0=[0.4, -0.3], v0=[0.2, 0.5], h=0.1, steps=20)
    weights = np.random.default_rng(3).normal(size=(21, 2))
    found = vi.gradient(motion, nodes=system.q * system.c[0], weights=weights)
    by = vi.sensitivity(motion, ["q0", "v0", "m", "k"], outputs=system.q * system.c[0])
    wanted = np.einsum("ko,kom->m", weights, by)
    flat = np.concatenate([found.q0, found.v0, [found.params["m"], found.params["k"]]])
    assert np.abs(flat - wanted).max() < 1e-12 * np.abs(wanted).max()
    assert found.value == pytest.approx((weights * motion.value(system.q * system.c[0])).sum())


def test_with_momenta_held_at_the_start_parameters_act_on_the_motion_alone():
    system, _ = spring()
    motion = vi.simulate(system, vi.gauss(2), q0=[0.4, -0.3], v0=[0.2, 0.5], h=0.1, steps=20)
    held = vi.gradient(motion, terminal_loss=system.q[0], held="p0")
    free = vi.gradient(motion, terminal_loss=system.q[0])
    assert np.allclose(held.p0 * 1.3, free.v0)  # p = m v
    # at fixed v a heavier body has more momentum
    assert free.params["m"] - held.params["m"] == pytest.approx(held.p0 @ [0.2, 0.5])


@pytest.mark.skipif(not is_built(), reason="installed without a compiler")
def test_loops_of_the_native_core_give_way_to_compiled_ones_of_the_same_digits():
    system, _ = spring()
    rule = vi.composition("kahan-li6")  # of which the compiled loops were made above
    motion = vi.simulate(system, rule, q0=[0.4, -0.3], v0=[0.2, 0.5], h=0.1, steps=200)
    loss = ca.sumsqr(system.q) + system.v[0] ** 2 * system.c[0]
    by = sweeper(system, rule, 10**6, "auto", as_text(system, loss))
    (kernel,) = by.kernels
    gears = kernel.adjoints.args[0]
    first = vi.gradient(motion, loss)
    while gears.high is None and gears.seconds < gears.expected:
        again = vi.gradient(motion, loss)
        gears.seconds += gears.expected / 8
    assert gears.work is not None or gears.high is not None
    deadline = monotonic() + 60
    while gears.work is not None and monotonic() < deadline:
        again = vi.gradient(motion, loss)
    assert gears.high is not None
    again = vi.gradient(motion, loss)
    assert np.array_equal(first.q0, again.q0) and repr(first) == repr(again)


def fewest_advances(pieces: int, states: int) -> int:
    """By dynamic programming: advance m pieces and store, take the others back, then these."""

    @cache
    def best(count: int, left: int) -> int:
        if count == 1 or not left:
            return count * (count - 1) // 2
        return min(m + best(count - m, left - 1) + best(m, left) for m in range(1, count))

    return best(pieces, states)


@pytest.mark.parametrize("pieces", [1, 2, 3, 7, 16, 40])
@pytest.mark.parametrize("states", [0, 1, 2, 3, 6])
def test_no_schedule_of_checkpoints_takes_fewer_steps(pieces, states):
    stored, taken, advances, most = {0}, [], 0, 0
    for act, at, to in schedule(pieces, states):
        assert at in stored
        if act == "drop":
            stored.remove(at)
            continue
        advances += to - at
        if act == "store":
            stored.add(to)
        else:
            taken.append(to)
        most = max(most, len(stored) - 1)
    assert taken == list(range(pieces))[::-1]
    assert most <= states and stored == {0}
    assert advances == fewest_advances(pieces, states)


@pytest.mark.parametrize("every", [40, 1600], ids=["every 40th", "the ends alone"])
@pytest.mark.parametrize("states", [80, 12, None], ids=["twice the root", "few", "by default"])
def test_a_gradient_with_nodes_left_out_holds_no_more_states_than_asked(every, states, monkeypatch):
    system, _ = spring()
    held = {"now": 0, "most": 0}

    def counted(made, size):
        def build(*given):
            found = made(*given)
            count = size(found)
            held["now"] += count
            held["most"] = max(held["most"], held["now"])
            weakref.finalize(keeper(found), lambda: held.update(now=held["now"] - count))
            return found

        return build

    def keeper(found):  # what lives as long as the numbers do
        return found.q if isinstance(found, vi.Trajectory) else found.x

    monkeypatch.setattr(checkpoints, "STORED", 0)
    advanced, again = checkpoints._advanced, checkpoints.piece_again
    monkeypatch.setattr(checkpoints, "_advanced", counted(advanced, lambda x: 1))
    monkeypatch.setattr(checkpoints, "piece_again", counted(again, lambda x: len(x.x)))
    given = dict(q0=[0.4, -0.3], v0=[0.2, 0.5], h=0.02, steps=1600)
    ends = vi.simulate(system, vi.gauss(2), **given, save_every=every)
    found = vi.gradient(ends, system.q[0] ** 2, system.v[0], states=states)
    most = 80 if states is None else states
    assert held["most"] <= most and (every == 40 or held["most"] > most / 2)
    whole = vi.gradient(vi.simulate(system, vi.gauss(2), **given), system.q[0] ** 2, system.v[0])
    for name in ("value", "q0", "v0", "h"):
        assert np.allclose(getattr(found, name), getattr(whole, name), rtol=1e-8)


def test_what_fits_into_memory_is_run_once_more_whole_and_longer_runs_in_pieces_of_64_MB():
    system, _ = spring()
    motion = vi.simulate(system, q0=[0.4, -0.3], v0=[0.2, 0.5], h=0.02, steps=4000, save_every=4000)
    numbers = checkpoints.numbers_of(motion)
    assert numbers == 5 * 2 + 3
    assert len(list(checkpoints.pieces_backwards(motion, 0, 1))) == 1
    room = checkpoints.room_for(10**7, None, numbers)
    assert room.checkpoints == 3162 and 2**26 - 8 * numbers < 8 * numbers * room.steps <= 2**26
    assert sum(checkpoints.room_for(10**13, None, numbers)) <= 2 * 10**6.5
    assert checkpoints.room_for(10**5, None, numbers).steps == 10**5


def test_losses_that_make_no_sense_are_refused_in_words():
    system, _ = spring()
    motion = vi.simulate(system, q0=[0.4, -0.3], v0=[0.2, 0.5], h=0.1, steps=4)
    q = system.q
    for given, words in (
        ({}, "nothing to differentiate"),
        (dict(loss=q), "one number"),
        (dict(terminal_loss=ca.SX.sym("z")), "unknown symbols"),
        (dict(weights=np.ones(5)), "nodes="),
        (dict(nodes=q, weights=np.ones(4)), r"\(5, 2\)"),
        (dict(loss=q[0], held="q0"), "'v0' or 'p0'"),
        (dict(loss=q[0], states=3), "whole number from 5"),
        (dict(loss=q[0], backend="fast"), "backend"),
    ):
        with pytest.raises(vi.InputError, match=words):
            vi.gradient(motion, **given)
    cart = driven_cart()
    driven = vi.simulate(cart, vi.gauss(2), q0=[0, 0], v0=[0, 0], h=0.1, steps=2, u=[1.0, 1.0])
    with pytest.raises(vi.InputError, match="controls"):
        vi.gradient(driven, terminal_loss=cart.control[0])


@pytest.mark.parametrize(
    ("model", "rule", "h"),
    [
        (vi.models.chain_rods(4), vi.lobatto(2), 1e-3),
        (vi.models.double_pendulum(), vi.gauss(2), 1e-6),
    ],
    ids=["rods", "links"],
)
def test_tiny_steps_from_rest_lose_no_derivative_to_round_off(model, rule, h):
    """Their mean velocities are round-off of q by h."""
    motion = vi.simulate(model.system, rule, q0=model.q0, v0=0 * model.v0, h=h, steps=20)
    loss = ca.sumsqr(model.system.q) + ca.sum1(model.system.q)
    one, other = (
        vi.gradient(motion, terminal_loss=loss, backend=x) for x in ("compiled", "interpreted")
    )
    assert np.allclose(one.q0, other.q0, rtol=1e-8, atol=1e-8 * np.abs(other.q0).max())
    assert np.allclose(one.p0, other.p0, rtol=1e-7, atol=1e-7 * np.abs(other.p0).max())
