"""The built pages in a browser, at the widths of a desk and of a telephone: nothing is cut off,
nothing comes from outside, search finds, pages are light.
"""

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "docs" / "_tools"))

import browser  # noqa: E402  (only findable now)

LIGHT = 1_000_000  # bytes of a gallery page before films, text packed as hosts send it

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(browser.browser() is None, reason="no browser without a screen here"),
    pytest.mark.skipif(
        not (browser.BUILT / "index.html").exists(), reason="python3 tasks.py docs builds the pages"
    ),
]


@pytest.fixture(scope="module")
def looked():
    return browser.measured(browser.pages())


def test_no_page_is_cut_off_or_broken_or_needs_a_network(looked):
    assert len(looked) == 2 * len(browser.pages()) > 200
    assert not {f"{row.page} at {row.width}": row.complaints for row in looked if row.complaints}


def test_formulas_are_typeset_without_a_network(looked):
    kepler = [row for row in looked if row.page == "gallery/kepler.html"]
    assert len(kepler) == 2 and all(row.numbers["formulas"] for row in kepler)


def test_a_gallery_page_loads_less_than_a_megabyte_before_films(looked):
    heavy = {
        row.page: row.numbers["bytes"]
        for row in looked
        if row.page.startswith("gallery/") and row.numbers["bytes"] >= LIGHT
    }
    assert not heavy


def test_search_finds_without_a_network():
    found = browser.measured(["search.html?q=pendulum", "search.html?q=xylophone"])
    many, none = ([r.numbers["found"] for r in found if r.page.endswith(q)] for q in ("lum", "one"))
    assert min(many) > 5 and max(none) == 0


def test_what_is_cut_off_is_found(tmp_path):
    (tmp_path / "wide.html").write_text(
        "<!doctype html><p style='width:900px'>wide</p>"
        "<pre style='overflow:auto'>" + "x" * 300 + "</pre><img src=gone.png alt='a picture'>"
    )
    (tmp_path / "good.html").write_text("<!doctype html><p>narrow</p><pre>x</pre>")
    rows = browser.measured(["wide.html", "good.html"], tmp_path)
    at = {(row.page, row.width): row.complaints for row in rows}
    assert not at["good.html", 420] and not at["good.html", 1400]
    text = " ".join(at["wide.html", 420])
    assert "908 pixels in 420" in text and "cut off: P: wide" in text and "cut off: PRE" in text
    assert "broken" in text
