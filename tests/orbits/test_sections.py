"""Sections: crossings to round-off, on the energy surface, none lost; starts of a given energy."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import varint as vi


def henon_heiles_starts(energy: float, y: np.ndarray) -> tuple[vi.System, dict]:
    system = vi.models.henon_heiles().system
    q0 = np.column_stack([0 * y, y])
    return system, vi.orbits.starts_at_energy(system, energy, q0=q0, v0=[0, 0], free=system.v[0])


def test_crossings_lie_on_the_surface_and_on_the_energy_of_their_motion_to_round_off():
    system, starts = henon_heiles_starts(1 / 12, np.linspace(-0.2, 0.4, 5))
    runs = vi.ensemble(system, vi.gauss(8), **starts, h=0.25, steps=4000)
    section = vi.orbits.poincare_section(runs, system.q[0])
    x, y = section.q.T
    energy = (section.v**2).sum(1) / 2 + (x**2 + y**2) / 2 + x**2 * y - y**3 / 3
    assert np.abs(x).max() < 1e-12 and np.abs(energy - 1 / 12).max() < 1e-13
    assert (section.v[:, 0] > 0).all() and set(section.motion) == {0, 1, 2, 3, 4}
    # none is lost: every change of sign between nodes is one of them
    q = np.asarray(runs.q)[:, :, 0]
    rises = ((q[:, 1:-1] <= 0) & (q[:, 2:] > 0)).sum()
    assert abs(len(section) - rises) <= len(runs)
    both = vi.orbits.poincare_section(runs, system.q[0], direction=0)
    falls = vi.orbits.poincare_section(runs, system.q[0], direction=-1)
    assert len(both) == len(section) + len(falls)


def test_a_section_is_of_the_accuracy_of_the_rule_and_not_of_interpolation():
    """The time of a return at three steps: the order of the rule, between nodes."""
    model, times = vi.models.henon_heiles(q0=(0.0, 0.2)), []
    for steps, stages in ((60, 3), (120, 3), (240, 3), (240, 8)):
        motion = vi.simulate(
            model.system, vi.gauss(stages), q0=model.q0, v0=model.v0, duration=30.0, steps=steps
        )
        times.append(vi.orbits.poincare_section(motion, model.system.q[0]).t[3])
    slopes = np.diff(np.log2(np.abs(np.array(times[:3]) - times[3])))
    assert (np.abs(slopes + 6) < 0.3).all(), slopes


def test_a_logged_crossing_is_the_same_section_from_few_nodes():
    system, starts = henon_heiles_starts(1 / 8, np.array([0.1]))
    q0, v0 = starts["q0"][0], starts["v0"][0]
    options = dict(q0=q0, v0=v0, h=0.25, steps=2000)
    every = vi.simulate(system, vi.gauss(6), **options)
    few = vi.simulate(
        system, vi.gauss(6), **options, save_every=1000, events={"section": (system.q[0], 1)}
    )
    show = (system.q[1], system.momentum[1])
    one = vi.orbits.poincare_section(every, system.q[0], show=show)
    other = vi.orbits.poincare_section(few, "section", show=show)
    assert np.allclose(one.points, other.points, atol=1e-11)


def test_the_boundary_is_where_nothing_is_left_for_the_other_direction():
    system, starts = henon_heiles_starts(1 / 8, np.linspace(-0.3, 0.5, 6))
    runs = vi.ensemble(system, vi.gauss(6), **starts, h=0.25, steps=2000)
    section = vi.orbits.poincare_section(runs, system.q[0])
    a, b, left = section.boundary
    y, p = np.meshgrid(a, b)
    exact = 1 / 8 - (p**2 / 2 + y**2 / 2 - y**3 / 3)
    inside = left > 0
    assert np.allclose(left[inside], exact[inside], atol=1e-14) and inside.any()
    assert not (inside[0].any() or inside[-1].any())
    assert section.plot().axes[0].get_title().endswith("E = 0.125")


def test_a_driven_scene_is_seen_once_a_period():
    q, v, t = *vi.coordinates("x"), vi.time()
    system = vi.System(q, v, v**2 / 2 + q**2 / 2 - q**4 / 4, force=-0.25 * v + 0.4 * ca.cos(t), t=t)
    motion = vi.simulate(system, vi.gauss(6), q0=1.0, v0=0.0, h=0.1, duration=200.0)
    section = vi.orbits.poincare_section(motion, ca.sin(t))
    assert np.allclose(section.t, 2 * np.pi * np.arange(1, len(section) + 1), rtol=1e-12)
    assert len(section) == 31 and section.boundary == ()


@pytest.mark.parametrize("which", [0, 1])
def test_starts_have_the_energy_wherever_it_is_put(which):
    model = vi.models.double_pendulum()
    s, rng = model.system, np.random.default_rng(3)
    q0, v0 = rng.uniform(-1, 1, (2, 20, 2))
    energy = vi.simulate(s, q0=[2, 2], v0=[0, 0], h=1e-3, steps=1).energy[0]
    for sign in (1, -1):
        found = vi.orbits.starts_at_energy(s, energy, q0=q0, v0=v0, free=s.v[which], direction=sign)
        runs = vi.ensemble(s, vi.gauss(2), **found, h=1e-3, steps=1)
        assert np.allclose(np.asarray(runs.energy)[:, 0], energy, rtol=1e-14)
        assert np.array_equal(found["v0"][:, 1 - which], v0[:, 1 - which])


def test_starts_of_a_relativistic_particle_are_found_by_newtons_method():
    q, v = vi.coordinates("x", "y")
    system = vi.System(q, v, -ca.sqrt(1 - ca.sumsqr(v)) - ca.sumsqr(q) / 2)
    found = vi.orbits.starts_at_energy(system, 2.0, q0=[0.5, 0.1], v0=[0, 0.3], free=system.v[0])
    speed = (found["v0"] ** 2).sum()
    assert np.isclose(1 / np.sqrt(1 - speed) + 0.26 / 2, 2.0, rtol=1e-14)


def test_bad_input_is_refused_in_words():
    system, starts = henon_heiles_starts(1 / 12, np.array([0.1]))
    start = dict(q0=starts["q0"][0], v0=starts["v0"][0], h=0.25)
    motion = vi.simulate(system, vi.gauss(6), **start, steps=100, save_every=10)
    whole = vi.simulate(system, vi.gauss(6), **start, steps=100)
    section, q, v = vi.orbits.poincare_section, system.q, system.v
    for work, words in (
        (lambda: section(motion, q[0]), "save_every=1"),
        (lambda: section(whole, "section"), "no crossing named"),
        (lambda: section(whole, q[0] + q[1]), "say what to show"),
        (lambda: section(whole, q[0], show=q[1]), "two expressions"),
        (lambda: section(whole, q[0], direction=2), "direction"),
        (lambda: section([], q[0]), "motion"),
        (lambda: section(3, q[0]), "motion"),
        (lambda: section([whole, 3], q[0]), "motions come from"),
        (
            lambda: vi.orbits.starts_at_energy(system, 0.1, q0=[0, 0.9], v0=[0, 0], free=v[0]),
            "not reached",
        ),
        (
            lambda: vi.orbits.starts_at_energy(system, 0.1, q0=[0, 0.1], v0=[0, 0], free=q[0]),
            "one velocity of",
        ),
        (
            lambda: vi.orbits.starts_at_energy(system, 0.1, q0=[0], v0=[0, 0], free=v[0]),
            "numbers with n = 2",
        ),
    ):
        with pytest.raises(vi.InputError, match=words):
            work()


def test_what_is_shown_of_a_section_counts_as_people_do():
    q, v = vi.coordinates("x")
    spring = vi.System(q, v, v**2 / 2 - q**2 / 2)
    motion = vi.simulate(spring, q0=1.0, v0=0.0, h=0.1, steps=60)
    falls = {"direction": -1, "show": (q, v)}
    shown = [repr(vi.orbits.poincare_section(motion, q - place, **falls)) for place in (3.0, 0.0)]
    assert shown == ["Section(no crossings)", "Section(1 crossing of 1 motion)"]
