"""Every Python block of README and documentation runs; pictures have words; links in the project lead somewhere."""

import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
sys.path.insert(0, str(DOCS / "_tools"))

from blocks import FIGURE, outcome, python_blocks  # noqa: E402  (only findable now)
from gallery import example  # noqa: E402
from chapters import CHAPTERS  # noqa: E402

GENERATED = {DOCS / "verification.md", DOCS / "benchmarks.md", *(DOCS / "gallery").glob("*.md")}
PAGES = sorted({*ROOT.glob("*.md"), *DOCS.glob("*.md"), *DOCS.glob("*/*.md")} - GENERATED)
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
MADE = re.compile(r"^(?:\.\./)?(?:gallery/\w+|verification|benchmarks)\.md$")  # by the build


def name_of(page):
    return str(page.relative_to(ROOT))


@pytest.mark.parametrize("page", [page for page in PAGES if python_blocks(page.read_text())], ids=name_of)
def test_every_python_block_runs(page):
    namespace = {"__name__": "page"}
    for number, code in enumerate(python_blocks(page.read_text(encoding="utf-8"))):
        if page.parent == ROOT:  # GitHub shows no comment as a caption: README has its picture below the block
            code = code.replace("motion.plot()", "motion.plot()\n# figure: below")
        outcome(code, namespace, f"{name_of(page)}, block {number}", draw=False)


def test_a_block_that_fails_or_warns_or_draws_without_words_is_found():
    with pytest.raises(ZeroDivisionError):
        outcome("1 / 0", {}, "here")
    with pytest.raises(UserWarning):
        outcome("import warnings; warnings.warn('no')", {}, "here")
    with pytest.raises(ValueError, match="1 figures but 0 lines"):
        outcome("import matplotlib.pyplot as plt; plt.figure()", {}, "here", draw=False)
    kept = {}
    assert outcome("x = 2", kept, "here").text == ""
    assert outcome("print(x + 1)", kept, "here").text == "3\n"
    drawn = outcome("import matplotlib.pyplot as plt; plt.plot([1, 2])\n# figure: a line", kept, "here").figures
    assert drawn[0][0] == "a line" and drawn[0][1].startswith(b"\x89PNG")


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_lead_to_files_and_pictures_have_words(page):
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.S)
    for bang, words, target in re.findall(r"(!?)\[([^\]]*)\]\(([^)\s]+)\)", text):
        assert not bang or len(words) > 10, f"{target} needs a description"
        path = target.split("#")[0]
        if path and not re.match(r"\w+:", path) and not MADE.match(path):
            assert (page.parent / path).exists(), f"{name_of(page)} links to {target}"


def test_figures_of_the_pages_are_described_in_whole_sentences():
    words = [w for page in PAGES for w in FIGURE.findall(page.read_text(encoding="utf-8"))]
    assert len(words) > 10
    assert all(len(w) > 40 and w.endswith(".") for w in words)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_has_what_the_gallery_shows(path):
    it = example(path)
    assert it.title and len(it.claim) > 30 and len(it.source) > 5


def test_every_chapter_of_the_gallery_has_examples_and_none_twice():
    names = [name for chapter in CHAPTERS.values() for name in chapter]
    assert len(names) == len(set(names))
    there = {path.stem for path in EXAMPLES}
    assert all(there & set(chapter) for chapter in CHAPTERS.values())


def test_every_page_is_in_a_table_of_contents():
    listed = set()
    for page in DOCS.rglob("*.md"):
        for body in re.findall(r"```\{toctree\}\n(.*?)```", page.read_text(encoding="utf-8"), re.S):
            entries = [line.strip() for line in body.splitlines() if line.strip() and not line.startswith(":")]
            listed |= {(page.parent / entry).with_suffix(".md").resolve() for entry in entries}
    pages = {page for page in PAGES if DOCS in page.parents} - {DOCS / "index.md", DOCS / "known_limits.md"}
    assert not {name_of(page) for page in pages - listed}
