"""Optimal controls against closed forms and independent solutions of Pontryagin's conditions."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from control_scenes import (
    REFERENCE,
    U,
    coarse,
    move,
    particle,
    pendulum,
    replay_defect,
    swing,
    swing_up,
)

import varint as vi

SWING_UP = REFERENCE["D02_cartpole_kelly"]["reference"]["J_int_u2"]


@pytest.mark.parametrize("rule", [vi.midpoint(), vi.gauss(3), vi.trapezoidal()])
@pytest.mark.parametrize(
    "row", REFERENCE["D01_min_energy_double_integrator_zoh"]["reference"]["rows"]
)
def test_piecewise_constant_control_of_the_double_integrator_costs_exactly_the_discrete_optimum(
    rule, row
):
    steps, cost = int(row[0]), row[1]
    assert move(rule, steps, control="constant").cost == pytest.approx(cost, rel=1e-12)


def test_minimum_energy_control_of_the_double_integrator_is_its_closed_form():
    reference = REFERENCE["D01_min_energy_double_integrator_general"]
    p = reference["params"]
    motion = move(
        vi.gauss(2),
        3,
        p["T"],
        start=dict(q=[p["x0"]], v=[p["v0"]]),
        end=dict(q=[p["x1"]], v=[p["v1"]]),
    )
    expected = reference["reference"]
    t = np.linspace(0, p["T"], 7)
    assert motion.cost == pytest.approx(expected["J_int_u2"], rel=1e-12)
    assert motion.u_at(t)[:, 0] == pytest.approx(
        expected["u_at_0"] + expected["u_slope"] * t, abs=1e-11
    )


@pytest.mark.parametrize(("row", "accuracy"), [(0, 1e-9), (1, 1e-9), (3, 1e-9), (4, 1e-9)])
def test_bryson_denham_costs_its_closed_form_where_the_entry_times_are_nodes(row, accuracy):
    bound, cost = REFERENCE["D01_bryson_denham"]["reference"]["rows"][row]
    q = particle().q
    motion = move(
        vi.gauss(3),
        30,
        cost=U**2 / 2,
        start=dict(q=[0], v=[1]),
        end=dict(q=[0], v=[-1]),
        bounds=[(None, q, bound)],
    )
    assert motion.cost == pytest.approx(cost, rel=accuracy)
    assert motion.q.max() <= bound + 1e-12
    assert any(name.startswith("x <=") for name in motion.solution.active)


@pytest.mark.parametrize("row", REFERENCE["D01_min_time_double_integrator"]["reference"]["rows"])
def test_two_phases_find_the_bang_bang_control_and_its_switching_time(row):
    x0, v0, duration, switch, first = row
    ends = [dict(start=dict(q=[x0], v=[v0])), dict(end=dict(q=[0], v=[0]))]
    phases = [
        vi.Phase(particle(), vi.gauss(2), vi.free(1, 0.01, 20), 4, 1, bounds=[(u, U, u)], **end)
        for u, end in zip((first, -first), ends, strict=True)
    ]
    one, two = vi.optimal_phases(phases)
    assert one.duration + two.duration == pytest.approx(duration, abs=1e-9)
    assert two.t[0] == pytest.approx(switch, abs=1e-9)
    assert one.solution.total_cost == pytest.approx(duration, abs=1e-9)
    assert two.q[0] == pytest.approx(one.q[-1], abs=1e-12)


def test_minimum_time_with_bounded_velocity_takes_the_closed_form_time():
    expected = REFERENCE["D01_min_time_double_integrator_vmax"]
    p, s = expected["params"], particle()
    motion = move(
        vi.gauss(2),
        44,
        vi.free(3, 0.1, 20),
        cost=0,
        terminal_cost=s.t,
        end=dict(q=[p["d"]], v=[0]),
        bounds=[(-p["umax"], U, p["umax"]), (-p["vmax"], s.v, p["vmax"])],
    )
    assert motion.duration == pytest.approx(expected["reference"]["T"], abs=1e-8)


@pytest.mark.parametrize(
    ("entry", "limit"),
    [
        ("D03_pendulum_min_time_u0p9", 0.9),
        ("D03_pendulum_min_time_u0p3", 0.3),
        ("D01_pendulum_min_time_u2", 2.0),
    ],
)
def test_switching_times_of_the_fastest_swing_up_solve_pontryagins_conditions(entry, limit):
    expected = REFERENCE[entry]["reference"]
    switches = expected.get("switch_times") or [expected["t_switch"]]
    times, phases, q, v, sign = [0.0, *switches, expected["T"]], [], 0.0, 0.0, 1.0
    for k, length in enumerate(np.diff(times) * (1 + 0.02 * (-1.0) ** np.arange(len(times) - 1))):
        u = sign * limit
        guess = vi.simulate(
            pendulum(), vi.gauss(4), q0=q, v0=v, duration=length, steps=20, u=np.full((20, 1), u)
        )
        q, v, sign = guess.q[-1], guess.v[-1], -sign
        ends = {} if k else {"start": dict(q=[0], v=[0])}
        if k == len(times) - 2:
            ends["end"] = dict(q=[np.pi], v=[0])
        phases.append(
            vi.Phase(
                pendulum(),
                vi.gauss(4),
                vi.free(length, 0.01, 20),
                20,
                1,
                bounds=[(u, U, u)],
                control="constant",
                guess=guess,
                **ends,
            )
        )
    found = vi.optimal_phases(phases)
    assert found[-1].t[-1] == pytest.approx(expected["T"], abs=1e-9)
    assert [x.t[-1] for x in found[:-1]] == pytest.approx(switches, abs=1e-8)
    assert max(map(replay_defect, found)) < 1e-9


def test_cart_pole_swings_up_at_the_published_cost_from_the_straight_line():
    motion = swing_up()
    assert motion.cost == pytest.approx(SWING_UP, rel=1e-8)
    assert replay_defect(motion) < 1e-9


@pytest.mark.parametrize(
    ("stages", "steps"),
    [(1, (40, 80, 160)), (2, (80, 120, 160)), (3, (60, 80, 120)), (4, (40, 60, 80))],
)
@coarse
def test_cost_of_the_swing_up_has_the_order_of_the_rule(stages, steps):
    start = swing_up()
    errors = [abs(swing_up(vi.gauss(stages), n, guess=start).cost - SWING_UP) for n in steps]
    order = -np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert order == pytest.approx(2 * stages, abs=0.25)


def test_piecewise_constant_controls_cap_the_order_at_two():
    start = swing_up()
    errors = [
        abs(swing_up(vi.gauss(4), n, guess=start, control="constant").cost - SWING_UP)
        for n in (40, 80, 160)
    ]
    assert np.log2(errors[1] / errors[2]) == pytest.approx(2, abs=0.15)


@pytest.mark.parametrize("entry", ["D02_pendulum_swingup_T2p5_c0", "D02_cartpole_kelly_lower"])
def test_swing_ups_cost_what_pontryagins_conditions_say(entry):
    reference = REFERENCE[entry]
    expected = reference["reference"]["J_int_u2"]
    if "pendulum" in entry:
        motion = swing(pendulum(), reference["params"]["T"])
    else:
        rows = np.array([row[:3] for row in reference["reference"]["rows"]])
        path = [lambda t, i=i: np.interp(t, rows[:, 0], rows[:, i]) for i in (1, 2)]
        motion = swing_up(guess=dict(q=lambda t: [f(t) for f in path]))
    assert motion.cost == pytest.approx(expected, rel=1e-8)


def test_multistart_finds_four_swing_ups_of_the_pendulum_and_the_cheapest_first():
    system = pendulum(9.81)
    phase = vi.Phase(
        system, vi.gauss(4), 3.0, 40, U**2, start=dict(q=[0], v=[0]), end=dict(q=[np.pi], v=[0])
    )
    found = vi.multistart(phase, 30)
    costs = [motion.cost for motion in found]
    assert len(costs) >= 4
    assert costs == sorted(costs)
    assert costs[0] == pytest.approx(36.6402890624, rel=1e-9)
    assert sum(motion.stats["found"] for motion in found) <= 30
    assert max(map(replay_defect, found)) < 1e-9


def test_multistart_finds_the_cheap_swing_up_that_the_straight_line_misses():
    reference = REFERENCE["D02_pendulum_swingup_T10_c0"]["reference"]["J_int_u2"]
    phase = vi.Phase(
        pendulum(),
        vi.gauss(4),
        10.0,
        40,
        U**2,
        start=dict(q=[0], v=[0]),
        end=dict(q=[np.pi], v=[0]),
    )
    assert swing(pendulum(), 10.0).cost > reference * 1.01
    assert vi.multistart(phase, 12)[0].cost == pytest.approx(reference, rel=1e-8)


def _orbit(entry: str, free_angle: bool) -> tuple[vi.Trajectory, dict]:
    reference = REFERENCE[entry]
    q, v = vi.coordinates("r", "phi")
    system = vi.System(
        q,
        v,
        (v[0] ** 2 + q[0] ** 2 * v[1] ** 2) / 2 + 1 / q[0],
        force=ca.vertcat(0, q[0] * U),
        control=U,
    )
    r, phi, _, rate = reference["initial"]["xT"]
    motion = vi.optimal_control(
        system,
        vi.gauss(4),
        duration=reference["times"][0],
        steps=40,
        cost=U**2,
        start=dict(q=[1, 0], v=[0, 1]),
        end=dict(q=[r, None if free_angle else phi], v=[0, rate]),
        guess=dict(q=lambda t: [1.1, 0.87 * t]),
    )
    return motion, reference["reference"]


@pytest.mark.parametrize(
    ("entry", "free_angle"),
    [("D02_orbit_transfer_d1", False), ("D02_orbit_transfer_d2_free_phi", True)],
)
def test_low_thrust_transfers_have_the_cost_and_the_costates_of_pontryagins_conditions(
    entry, free_angle
):
    motion, expected = _orbit(entry, free_angle)
    assert motion.cost == pytest.approx(expected["J_int_u2"], rel=1e-9)
    assert replay_defect(motion) < 1e-9
    # from (q, p) to (q, v): p = (r', r² phi'), so λ_v = Mᵀ λ_p and λ_q gains (∂p/∂q)ᵀ λ_p
    for k, t in ((0, 0), (-1, -1)):
        r, rate = motion.q[k, 0], motion.v[k, 1]
        (lam_r, lam_phi), (mu_r, mu_phi) = motion.costates.q[k], motion.costates.p[k]
        costate = [lam_r + 2 * r * rate * mu_phi, lam_phi, mu_r, r**2 * mu_phi]
        assert costate == pytest.approx(expected["rows"][t][5:9], rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("kind", ["hard", "soft"])
def test_low_thrust_transfer_with_hard_and_soft_ends(kind):
    reference = REFERENCE[f"D04_orbit_transfer_konopik_{kind}"]
    p = REFERENCE["D04_orbit_transfer_konopik_soft"]["params"] | reference["params"]
    q, v = vi.coordinates("x", "y")
    radius = ca.norm_2(q)
    system = vi.System(
        q,
        v,
        ca.sumsqr(v) / 2 + p["mu"] / radius,
        force=U * ca.vertcat(-q[1], q[0]) / radius,
        control=U,
    )
    miss = ca.sumsqr(q - ca.DM(p["qT"])) + ca.sumsqr(v - ca.DM(p["vT"]))
    soft = dict(terminal_cost=miss) if kind == "soft" else dict(end=dict(q=p["qT"], v=p["vT"]))
    start = reference["initial"]

    def spiral(t):
        angle, r = 3 * np.pi * t / 28, 4 + t / 28
        return [r * np.cos(angle), r * np.sin(angle)]

    motion = vi.optimal_control(
        system,
        vi.gauss(4),
        duration=p["T"],
        steps=80,
        cost=U**2 / 2,
        start=start,
        guess=dict(q=spiral),
        **soft,
    )
    expected = reference["reference"]
    assert motion.cost == pytest.approx(
        expected["J" if kind == "soft" else "half_int_u2"], rel=1e-8
    )
    assert replay_defect(motion) < 1e-9


def test_linear_tangent_steering_takes_the_closed_form_time_and_follows_its_law():
    reference = REFERENCE["D01_linear_tangent_steering"]
    p, expected = reference["params"], reference["reference"]
    q, v = vi.coordinates("x", "y")
    system = vi.System(
        q, v, ca.sumsqr(v) / 2, force=p["a"] * ca.vertcat(ca.cos(U), ca.sin(U)), control=U
    )
    motion = vi.optimal_control(
        system,
        vi.gauss(3),
        duration=vi.free(1, 0.1, 5),
        steps=30,
        cost=1,
        start=reference["initial"],
        end=dict(q=[None, p["y_T"]], v=[p["vx_T"], 0]),
        bounds=[(-2, U, 2)],
    )
    s = np.linspace(0.1, 0.9, 9)
    assert motion.duration == pytest.approx(expected["T"], rel=1e-10)
    assert np.tan(motion.solution.u(s)[:, 0]) == pytest.approx(
        expected["tan_beta0"] * (1 - 2 * s), abs=3e-5
    )
