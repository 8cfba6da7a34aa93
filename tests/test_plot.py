"""Figures of trajectories show what a scene has, mark its events, and nothing else."""

import numpy as np
import pytest

import varint as vi


def titles(figure):
    return [axes.get_title() for axes in figure.axes]


def motion_of(name, **changes):
    model = vi.models.catalogue[name]()
    return vi.simulate(model.system, **model.start | changes)


@pytest.mark.parametrize(
    ("name", "extra"),
    [("pendulum", []), ("kepler", []), ("rosette", ["Momenta of cyclic coordinates"]), ("atwood", ["Multipliers"]),
     ("cart_pole", ["Controls"]), ("knife_edge", ["Multipliers"])],
)  # fmt: skip
def test_panels_are_those_that_the_scene_has(name, extra):
    panels = titles(motion_of(name, duration=0.5, h=0.01).plot())
    assert panels[:2] == ["Coordinates", "Phase portrait"] and panels[2].startswith("Energy")
    assert panels[3:] == extra


def test_multipliers_are_drawn_as_they_are():
    motion = motion_of("pendulum_cartesian", duration=1.0)
    axes = motion.plot().axes[3]
    assert np.array_equal(axes.lines[0].get_ydata(), motion.multipliers[:, 0])


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
