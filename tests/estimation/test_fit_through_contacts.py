"""Parameters of scenes with contacts from measurements: restitution, starts and forces through
impacts, stops and detachments.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import varint as vi

RULE = vi.lobatto(3)
TIMES = np.linspace(0.013, 1.97, 60)  # three bounces, none at a node


def ball() -> vi.System:
    q, v = vi.coordinates("y")
    c = vi.Parameters(e=0.7, g=9.81)
    return vi.System(q, v, v**2 / 2 - c.g * q, contact=q, restitution=c.e, params=c)


def heights(system: vi.System, e: float, noise: float = 0.0, q0: float = 1.0) -> vi.Measurement:
    true = vi.simulate(system, RULE, q0=q0, v0=0.3, h=0.05, steps=40, params=dict(e=e))
    values = true.at(TIMES).q[:, 0] + noise * np.random.default_rng(1).normal(size=len(TIMES))
    return vi.Measurement(system.q, TIMES, values, sigma=noise or 1e-3)


def test_restitution_gravity_and_start_are_recovered_from_heights_without_noise():
    """From 0.5 instead of 0.82: three bounces in the data, five in the guess."""
    system = ball()
    unknown = {"e": 0.5, "g": 9.5, "q0": 1.1, "v0": 0.0}
    found = vi.fit(system, RULE, data=heights(system, 0.82), unknown=unknown, h=0.05, q0=1, v0=0)
    parts = *found.params.values(), found.q0[0][0], found.v0[0][0]
    assert np.abs(np.array(parts) - [0.82, 9.81, 1.0, 0.3]).max() < 1e-10
    motion = found.trajectories[0]
    assert len(motion.events) == 3
    assert found.residuals[0][0].max() < 1e-7


def closed_form(e: float, q0: float, t: np.ndarray) -> np.ndarray:
    """∂y/∂(e, q0) of a ball from q0 with 0.3 upwards, flight by flight."""
    z, g = ca.SX.sym("z", 2), 9.81
    begin, height, speed, rows = ca.SX(0), z[1], ca.SX(0.3), []
    for _ in range(6):
        hit = begin + (speed + ca.sqrt(speed**2 + 2 * g * height)) / g
        rows.append((begin, height, speed, hit))
        begin, speed, height = hit, z[0] * ca.sqrt(speed**2 + 2 * g * height), ca.SX(0)
    y = []
    for time in t:
        value = ca.SX(0)
        for begin, height, speed, hit in rows:
            since = time - begin
            there = ca.logic_and(since >= 0, time < hit)
            value = ca.if_else(there, height + speed * since - g * since**2 / 2, value)
        y.append(value)
    slope = ca.jacobian(ca.vertcat(*y), z)
    return np.array(ca.Function("slope", [z], [slope])([e, q0]).full())


def test_the_covariance_through_bounces_is_the_cramer_rao_bound_of_the_closed_form():
    system, noise = ball(), 0.01
    data = heights(system, 0.8, noise)
    found = vi.fit(system, RULE, data=data, unknown=["e", "q0"], h=0.05, q0=1.0, v0=0.3)
    of = closed_form(float(found.params["e"]), float(found.q0[0][0]), TIMES)
    bound = noise**2 * np.linalg.inv(of.T @ of)
    assert np.abs(found.covariance - bound).max() < 1e-8 * np.abs(bound).max()
    assert np.abs(found.estimates - [0.8, 1.0]).max() < 4 * found.sigma.max()
    assert not found.unidentifiable


@pytest.mark.long
def test_a_start_with_other_bounces_is_left_behind_by_the_first_data():
    """The user's guess ends in a minimum that is none of the data's; that of the first flights
    leads to theirs.
    """
    system, t = ball(), np.linspace(0.013, 4.97, 200)
    true = vi.simulate(system, RULE, q0=1.0, v0=0.3, h=0.02, steps=250, params=dict(e=0.85))
    data = vi.Measurement(system.q, t, true.at(t).q[:, 0], sigma=0.005)
    unknown = {"e": 1.0, "g": 9.0, "q0": 0.8, "v0": 0.0}
    found = vi.fit(system, RULE, data=data, unknown=unknown, h=0.02, q0=0.8, v0=0.0)
    assert len(true.events) == 14
    assert np.abs(found.estimates - [0.85, 9.81, 1.0, 0.3]).max() < 1e-8


def test_restitution_stays_between_zero_and_one():
    system = ball()
    data = heights(system, 1.0, 0.01)
    more = vi.Measurement(system.q, TIMES, data.values + 0.05 * TIMES[:, None], sigma=0.01)
    with pytest.warns(UserWarning, match="not met"):
        found = vi.fit(system, RULE, data=more, unknown=["e"], h=0.05, q0=1.0, v0=0.3)
    assert float(found.params["e"]) == 1.0 and found.at_bounds == ("e",)


def test_what_never_bounced_says_nothing_of_restitution():
    system = ball()
    early = vi.Measurement(system.q, TIMES[:9], heights(system, 0.8).values[:9], sigma=1e-3)
    with pytest.warns(UserWarning, match="e does not show in the data"):
        found = vi.fit(system, RULE, data=early, unknown=["e", "g"], h=0.05, q0=1.0, v0=0.3)
    assert float(found.params["g"]) == pytest.approx(9.81, rel=1e-9)


def test_a_block_that_leaves_a_sphere_tells_gravity_and_when_it_let_go():
    model = vi.models.slide_off_sphere()
    steps = round(model.duration / model.h / 4)
    h = model.duration / steps
    truth = dict(gravity=9.4)
    run = dict(q0=model.q0, v0=model.v0, h=h)
    true = vi.simulate(model.system, RULE, **run, steps=steps, params=truth)
    kinds = [event.kind for event in true.events]
    t = np.linspace(0.02, 0.95 * model.duration, 9)
    data = vi.Measurement(model.system.q, t, true.at(t).q, sigma=1e-3)
    found = vi.fit(model.system, RULE, data=data, unknown={"gravity": 9.81}, **run)
    assert float(found.params["gravity"]) == pytest.approx(9.4, rel=1e-9)
    assert kinds == [event.kind for event in found.trajectories[0].events]
    assert "detachment" in kinds


def test_what_a_fit_with_contacts_cannot_do_is_said():
    system = ball()
    given = dict(data=heights(system, 0.8), unknown=["e"], h=0.05, v0=0.3)
    with pytest.raises(vi.InputError, match="take segments=1"):
        vi.fit(system, RULE, **given, q0=1.0, segments=4)
    with pytest.raises(vi.ConvergenceError, match="violates the contacts"):
        vi.fit(system, RULE, **given, q0=-1.0)
