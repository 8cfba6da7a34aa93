"""Pictures of the pages: a card for every example, figures for dark pages, blocks that fit."""

import io
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "docs" / "_tools"))

import cards  # noqa: E402  (only findable now)
import dark  # noqa: E402
from blocks import outcome  # noqa: E402

EXAMPLES = {path.stem for path in (ROOT / "examples").glob("*.py")}


def test_every_example_has_a_card():
    assert set(cards.SCENES) == EXAMPLES


@pytest.mark.parametrize("name", ["exact_actions", "obstacle"])
def test_a_card_is_small_and_has_no_ground_of_its_own(name, tmp_path):
    cards.draw(name, tmp_path)
    data = (tmp_path / f"{name}-card.png").read_bytes()
    picture = np.asarray(Image.open(io.BytesIO(data)).convert("RGBA"))
    assert picture.shape == (240, 390, 4) and len(data) < 20_000
    drawn = picture[..., 3] > 128
    assert 0.005 < drawn.mean() < 0.6
    rows, columns = np.flatnonzero(drawn.any(axis=1)), np.flatnonzero(drawn.any(axis=0))
    # it fills the picture in one direction and is not cut off in any
    assert max(np.ptp(rows) / 240, np.ptp(columns) / 390) > 0.8
    assert rows[0] > 0 and rows[-1] < 239 and columns[0] > 0 and columns[-1] < 389
    assert cards.is_kept(name, tmp_path)


def test_colours_of_a_card_run_with_time():
    curve = np.column_stack([np.linspace(0, 1, 50), np.zeros(50)])
    data = cards.png(cards.Card([curve], [], np.empty((0, 2))))
    row = np.asarray(Image.open(io.BytesIO(data)).convert("RGBA"))[120]
    left, right = row[row[:, 3] > 200][[2, -3], :3].astype(int)
    assert left[2] > left[0] and right[0] > right[2]  # blue first, orange last


def test_on_dark_pages_white_is_paper_black_is_ink_and_colours_keep_their_hue():
    white, black, blue = dark.dark_colours([[1, 1, 1, 1], [0, 0, 0, 0.5], [0, 0.2, 0.5, 1]])
    assert white == pytest.approx([dark.PAPER] * 3 + [1])
    assert black == pytest.approx([dark.INK] * 3 + [0.5])
    assert blue[2] > blue[1] > blue[0] and blue[:3] @ dark.WEIGHTS > 0.2


def test_a_figure_is_darkened_once_and_wholly():
    figure, axes = plt.subplots()
    (line,) = axes.plot([0, 1], "ko-", label="black")
    shades = axes.scatter([0, 1], [1, 0], c=[0.0, 1.0])
    before = shades.get_array().copy()
    axes.set_title("title")
    axes.legend()
    dark.darken(figure)
    assert figure.get_facecolor() == axes.get_facecolor() == pytest.approx((*[dark.PAPER] * 3, 1))
    ink = (*[dark.INK] * 3, 1)
    assert axes.title.get_color() == pytest.approx(ink)
    assert line.get_color() == line.get_markerfacecolor() == pytest.approx(ink)
    assert np.array_equal(shades.get_array(), before)
    assert axes.get_legend().get_texts()[0].get_color() == pytest.approx(ink)


def test_few_colours_look_the_same():
    ramp = np.linspace(0, 255, 200).astype(np.uint8)
    large = io.BytesIO()
    Image.fromarray(np.stack([np.tile(ramp, (200, 1))] * 3, axis=-1)).save(large, format="PNG")
    small = Image.open(io.BytesIO(dark.few_colours(large.getvalue())))
    assert small.mode == "P"
    apart = np.abs(np.asarray(small.convert("RGB"))[0, :, 0].astype(int) - ramp)
    assert apart.max() <= 2


def test_a_film_is_a_block_s_value_and_has_words():
    code = (
        "import varint as vi\nm = vi.models.pendulum()\n"
        "x = vi.simulate(m.system, q0=m.q0, v0=m.v0, h=0.05, steps=4)\n"
        "x.animate(sketch=vi.models.sketch(m), fps=10)"
    )
    with pytest.raises(ValueError, match="1 films but 0 lines"):
        outcome(code, {}, "here", draw=False)
    found = outcome(f"{code}\n# film: a pendulum", {}, "here")
    [(words, film)] = found.films
    assert words == "a pendulum" and film[:3] == b"GIF" and not found.figures


def test_wide_blocks_are_set_smaller_and_tables_stay_in_columns():
    pytest.importorskip("sphinx")
    from fitted import classes

    assert classes("x" * 100, "python") == []
    assert classes("x" * 108, "python") == ["wide-110"]
    assert classes("x" * 141, "text") == ["wrapped"]
    assert classes("rule   step   error\ngauss  0.1    1e-3", "text") == ["columns"]
    assert classes("one sentence of words\nand another", "text") == []


def test_formulas_side_by_side_are_divided_at_wide_spaces_that_stand_in_no_group():
    pytest.importorskip("sphinx")
    from formulas import pieces

    assert pieces(r"a = b ,\qquad c = \{d\}") == ["a = b ,", r"c = \{d\}"]
    assert pieces(r"\frac{a \qquad b}{c}") == [r"\frac{a \qquad b}{c}"]
    together = r"\begin{cases} a \qquad b \end{cases}"
    assert pieces(together) == [together]
