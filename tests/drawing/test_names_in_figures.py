"""Names are the user's: whatever stands in them, figures are drawn."""

import casadi as ca
import numpy as np
from matplotlib import pyplot as plt
from matplotlib.text import Text

import varint as vi

BROKEN = ("$\\frac{a", "$$", "$a$ and $\\bad$", "$\\left( q$")
READ = "$\\alpha_1$"


def run():
    """A free particle and oscillators, every coordinate and an event with such a name."""
    q, v = vi.coordinates(*BROKEN, READ)
    system = vi.System(q, v, ca.sumsqr(v) / 2 - ca.sumsqr(q[1:]) / 2)
    start = {"q0": np.full(5, 0.5), "v0": np.ones(5)}
    return vi.simulate(system, vi.gauss(2), **start, h=0.2, steps=9, events={BROKEN[1]: q[1]})


def test_names_that_are_no_mathematics_are_drawn_as_they_are():
    motion = run()
    named = motion.plot({BROKEN[2]: motion.system.q[0]})
    for figure, names in ((motion.plot(), (*BROKEN, READ)), (named, BROKEN[2:3])):
        figure.draw_without_rendering()
        texts = figure.findobj(Text)
        for name in names:
            parsed = {x.get_parse_math() for x in texts if x.get_text() == name}
            assert parsed == {name == READ}
        plt.close(figure)


def test_previews_and_live_plots_take_any_name():
    motion = run()
    assert "<img" in motion._repr_html_()
    figure = plt.figure()
    vi.live_plot(figure)(0, 1.0, 1.0, motion)
    figure.draw_without_rendering()
    plt.close(figure)
