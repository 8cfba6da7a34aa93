"""Figures of trajectories show what a scene has, mark its events, and nothing else."""

import numpy as np
import pytest

import varint as vi
from varint.drawing.curves import curve_of


def titles(figure):
    return [axes.get_title() for axes in figure.axes]


def motion_of(name, **changes):
    model = vi.models.catalogue[name]()
    return vi.simulate(model.system, **model.start | changes)


@pytest.mark.parametrize(
    ("name", "extra"),
    [
        ("pendulum", []),
        ("kepler", []),
        ("rosette", ["Momenta of cyclic coordinates"]),
        ("atwood", ["Multipliers"]),
        ("cart_pole", ["Controls"]),
        ("knife_edge", ["Multipliers"]),
    ],
)
def test_panels_are_those_that_the_scene_has(name, extra):
    panels = titles(motion_of(name, duration=0.5, h=0.01).plot())
    assert panels[:2] == ["Coordinates", "Phase portrait"] and panels[2].startswith("Energy")
    assert panels[3:] == extra


def test_multipliers_are_drawn_as_they_are():
    motion = motion_of("pendulum_cartesian", duration=1.0)
    axes = motion.plot().axes[3]
    assert np.array_equal(axes.lines[0].get_ydata(), curve_of(motion).multipliers[:, 0])


def test_momenta_are_drawn_as_their_change():
    motion = motion_of("rosette", duration=1.0)
    axes = motion.plot().axes[3]
    assert np.allclose(axes.lines[0].get_ydata(), motion.p[:, 1] - motion.p[0, 1], atol=0)


def test_events_are_marked_where_they_happened_and_named_once():
    motion = motion_of("bouncing_ball", duration=3.0)
    top, phase, energy = motion.plot().axes[:3]
    times = [event.time for event in motion.events]
    for axes in (top, energy):
        marks = [line.get_xdata()[0] for line in axes.lines if len(set(line.get_xdata())) == 1]
        assert len(times) > 2 and marks == times
    assert [text.get_text() for text in top.get_legend().get_texts()].count("impact") == 1
    assert all(len(set(line.get_xdata())) > 1 for line in phase.lines)


def test_events_are_marked_beside_expressions_too():
    q = vi.models.bouncing_ball().system.q
    motion = motion_of("bouncing_ball", duration=1.0)
    (axes,) = motion.plot(q).axes
    assert len(axes.lines) == 1 + len(motion.events)


def test_the_energy_is_drawn_itself_where_it_is_not_conserved_and_its_error_where_it_is():
    lossy = vi.models.bouncing_ball(restitution=0.8)
    motions = [vi.simulate(lossy.system, **lossy.start), motion_of("driven_pendulum", duration=1.0)]
    for motion in motions:
        axes = motion.plot().axes[2]
        assert axes.get_title() == "Energy" and np.array_equal(
            axes.lines[0].get_ydata(), curve_of(motion).energy
        )
    for name in ("pendulum", "falling_ladder"):
        motion = motion_of(name, duration=0.5)
        axes = motion.plot().axes[2]
        assert axes.get_title() == "Energy error" and abs(axes.lines[0].get_ydata()).max() < 1e-6


def test_axes_of_expressions_are_named_by_a_dictionary_or_by_what_they_are():
    motion = motion_of("double_pendulum", duration=0.1)
    s = motion.system
    figure = motion.plot(s.q[0], s.energy, {"height in m": s.q[1], "speed": s.v[0]}, s.momentum[0])
    names = [axes.get_ylabel() for axes in figure.axes]
    assert names == ["$\\theta_{1}$", "energy $H$", "height in m", "speed", "expression 5"]


def test_controls_with_several_values_a_step_are_drawn_at_their_nodes():
    (motion,) = vi.models.swing_up_cart_pole().solve()
    axes = next(axes for axes in motion.plot().axes if axes.get_title() == "Controls")
    line = axes.lines[0]
    assert len(line.get_xdata()) == motion.u[:, :, 0].size
    assert np.allclose(line.get_ydata(), motion.u_at(line.get_xdata())[:, 0], atol=1e-9)


@pytest.mark.parametrize(
    ("name", "title"),
    [("outer_solar_system", "Coordinates (7 of 18)"), ("double_pendulum", "Coordinates")],
)
def test_a_panel_says_where_it_draws_some_of_many_curves(name, title):
    top, phase = motion_of(name, duration=vi.models.catalogue[name]().h * 5).plot().axes[:2]
    assert top.get_title() == title
    assert phase.get_title() == title.replace("Coordinates", "Phase portrait")
    drawn = len(top.lines)
    assert drawn == len(top.get_legend().get_texts()) and (f"{drawn} of" in title) == (drawn == 7)


def test_momenta_and_multipliers_say_it_too():
    q, v = vi.coordinates(*(f"x{i}" for i in range(9)))
    free = vi.System(q, v, v.T @ v / 2)
    motion = vi.simulate(free, q0=np.zeros(9), v0=np.ones(9), h=0.1, steps=5)
    assert "Momenta of cyclic coordinates (7 of 9)" in titles(motion.plot())
    held = vi.System(q, v, v.T @ v / 2 - q[0], constraint=q)
    motion = vi.simulate(held, q0=np.zeros(9), v0=np.zeros(9), h=0.1, steps=5)
    assert "Multipliers (7 of 9)" in titles(motion.plot())


def test_all_components_of_an_expression_are_drawn():
    motion = motion_of("outer_solar_system", duration=1000.0)
    (axes,) = motion.plot(motion.system.q).axes
    assert len(axes.lines) == 18


@pytest.mark.parametrize("name", ["pendulum", "kepler"])
def test_a_phase_portrait_shows_its_direction_and_none_where_nothing_moves(name):
    motion = motion_of(name, duration=3.0)
    phase, curve = motion.plot().axes[1], curve_of(motion)
    arrows = [(np.array(x.xyann), np.array(x.xy)) for x in phase.texts]
    assert len(arrows) == 3 * motion.q.shape[1]
    for tail, head in arrows:
        nodes = [np.stack(pair, axis=-1) for pair in zip(curve.q.T, curve.p.T, strict=True)]
        steps = [(path[:-1] == tail).all(axis=1) & (path[1:] == head).all(axis=1) for path in nodes]
        assert any(step.any() for step in steps)
    still = vi.simulate(motion.system, q0=motion.q[0], v0=motion.v[0], h=0.01, steps=1)[:1]
    assert not still.plot().axes[1].texts


def test_names_of_many_curves_stand_beside_their_panel_and_those_of_few_within():
    for name, beside in (("outer_solar_system", True), ("double_pendulum", False)):
        figure = motion_of(name, duration=vi.models.catalogue[name]().h * 5).plot()
        figure.draw_without_rendering()
        top, phase, *_ = figure.axes
        names, panel = top.get_legend().get_window_extent(), top.get_window_extent()
        assert (names.x0 >= panel.x1) == beside and (names.x1 <= panel.x1) == (not beside)
        assert names.x1 <= phase.get_window_extent().x0
