"""In notebooks a figure shows once, a film leaves no empty frame, and bars need no more than is
installed.
"""

from __future__ import annotations

import sys
import types
import warnings

import matplotlib
import pytest
from matplotlib import pyplot as plt

import varint as vi
from varint.numerics.progress import bar_class


@pytest.fixture
def motion():
    model = vi.models.kepler()
    return vi.simulate(model.system, **model.start | {"duration": 0.5})


@pytest.fixture
def inline(monkeypatch):
    """Matplotlib's backend of notebooks: what pyplot holds at the end of a cell is shown."""
    monkeypatch.setattr(
        matplotlib, "get_backend", lambda: "module://matplotlib_inline.backend_inline"
    )
    plt.close("all")
    yield
    plt.close("all")


def figures(motion):
    many = vi.ensemble(motion.system, q0=[[1, 0], [1.1, 0]], v0=[0, 1], h=0.01, steps=20)
    return {
        "trajectory": lambda: motion.plot(),
        "expressions": lambda: motion.plot(motion.system.q[0], motion.system.energy),
        "conserved": lambda: motion.conserved().plot(),
        "ensemble": lambda: many.plot(),
    }


@pytest.mark.parametrize("kind", ["trajectory", "expressions", "conserved", "ensemble"])
def test_a_figure_in_a_notebook_is_the_value_of_its_cell_and_nothing_else(kind, motion, inline):
    figure = figures(motion)[kind]()
    assert not plt.get_fignums()
    figure.canvas.draw()
    assert figure.axes


def test_a_film_in_a_notebook_leaves_no_empty_frame_and_can_be_shown(motion, inline):
    film = motion.animate(speed=0.25, fps=10)
    assert not plt.get_fignums()
    assert film.to_jshtml(embed_frames=True).count("data:image/png") > 10


def test_elsewhere_pyplot_shows_a_figure(motion):
    plt.close("all")
    figure = motion.plot()
    assert plt.get_fignums() == [figure.number]
    plt.close("all")


@pytest.mark.parametrize("widgets", [False, True])
def test_bars_in_a_notebook_fit_what_is_installed_without_a_warning(widgets, monkeypatch):
    monkeypatch.setitem(sys.modules, "IPython", types.ModuleType("IPython"))
    monkeypatch.setattr(
        "varint.numerics.progress.find_spec", lambda name: object() if widgets else None
    )
    for name in [name for name in sys.modules if name.startswith("tqdm.auto")]:
        monkeypatch.delitem(sys.modules, name)
    if widgets:
        return _widget_bar_is_the_automatic_one(monkeypatch)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with bar_class()(total=3, disable=True) as bar:
            bar.update(3)
    assert bar_class().__module__ == "tqdm.std"


def _widget_bar_is_the_automatic_one(monkeypatch):
    automatic = types.ModuleType("tqdm.auto")
    automatic.tqdm = type("Automatic", (), {})
    monkeypatch.setitem(sys.modules, "tqdm.auto", automatic)
    assert bar_class() is automatic.tqdm
