"""Every Python block of README and documentation runs; pictures have words; links in the project lead somewhere."""

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
sys.path.insert(0, str(DOCS / "_tools"))

import benchmark_page  # noqa: E402  (only findable now)
from blocks import FIGURE, marked_blocks, outcome, python_blocks  # noqa: E402  (only findable now)
from chapters import CHAPTERS  # noqa: E402
from gallery import example  # noqa: E402

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


SCRIPTS = [(page, code) for page in PAGES for kind, code in marked_blocks(page.read_text("utf-8")) if kind == "script"]


@pytest.mark.parametrize(("page", "code"), SCRIPTS, ids=lambda x: name_of(x) if isinstance(x, Path) else "")
def test_every_script_runs_as_a_file(page, code, tmp_path):
    (tmp_path / "script.py").write_text(code, encoding="utf-8")
    environment = os.environ | {"PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"}
    command = [sys.executable, "-W", "error", "script.py"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert done.stdout


def test_there_is_no_python_that_does_not_run_but_for_tools_that_pip_does_not_install():
    fences = re.compile(r"^ *```+ *(\{code-block\} *)?python\b", re.M)
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        marked = [kind for kind, _ in marked_blocks(text)]
        assert len(fences.findall(text)) == len(python_blocks(text)) + len(marked), page
        allowed = {"still", "illustration"} if page.name == "coming-from.md" else {"script"}  # test_coming_from.py
        assert set(marked) <= allowed, page
        assert not re.search(r"^```\s*\n(?=import |from )", text, re.M), f"{page}: Python without a language"


COMMAND = re.compile(r"python -m varint ((?:list|run|check|bench)\b[^`|\n]*)")
COMMANDS = sorted({found.strip() for page in PAGES for found in COMMAND.findall(page.read_text("utf-8"))})


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_of_the_pages_runs(command, tmp_path, monkeypatch, capsys):
    from varint import __main__ as shell

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(shell, "STEPS", (16, 32))  # of a benchmark: that it runs, not how fast
    short = [] if command == "list" or "--duration" in command else ["--duration", "1"]
    assert shell.main(shlex.split(command) + short) == 0
    assert capsys.readouterr().out
    for file in re.findall(r"\S+\.(?:png|gif|npz)", command):
        assert (tmp_path / file).stat().st_size > 1000


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


def test_the_benchmark_page_shows_what_was_measured_when_and_on_what_and_says_what_was_not(tmp_path):
    rows = [
        {"wanted": 1e-6, "tool": "varint", "seconds": 0.0005, "error": 3e-7, "setting": "gauss(8)", "setup": 0.1},
        {"wanted": 1e-6, "tool": "peer", "seconds": 0.001, "error": 8e-7, "setting": "", "setup": 0.0},
        {"wanted": 1e-9, "tool": "peer", "seconds": 0.002, "error": 8e-10, "setting": "", "setup": 0.0},
    ]
    ratios = [{"ratio": 0.5, "scene": "comet", "wanted": 1e-6, "measure": "q", "long": True}]
    about = {"date": "2026-01-31", "processor": "abacus", "cores": 3, "varint": "9.9"}
    scenes = {"comet": {"apart": 1e-14, "rows": rows, "all": rows, "setup": {}}}
    results = tmp_path / "results"
    results.mkdir()
    whole = {"measured_with": about, "scenes": scenes, "geometric means": {"error of q": 0.5}, "ratios": ratios}
    (results / "work_precision.json").write_text(json.dumps(whole))
    (results / "long_run.json").write_text(json.dumps({"rows": [{"steps": 10**8, "drift": -1.25e-7, "none": None}]}))
    page = tmp_path / "page" / "benchmarks.md"
    benchmark_page.write(page, results)
    text = page.read_text()
    assert "Measured on abacus, 3 cores, 2026-01-31, varint 9.9." in text and "date not recorded" in text
    assert "- error of q: 0.50" in text and "| comet | 0.5 |" in text
    assert "| 1e-06 | 0.5 | 1 |" in text and "| 1e-09 | – | 2 |" in text
    assert "| 100,000,000 | −1.2e−7 | – |" in text
    assert (page.parent / "_build" / "work_precision.png").read_bytes().startswith(b"\x89PNG")
    missing = text.partition("## Not measured")[2]
    assert "`stress`" in missing and "`work_precision`" not in missing
    benchmark_page.write(page, tmp_path / "nothing")
    assert "`work_precision`" in page.read_text()


def test_every_stored_result_has_a_title_and_words_on_the_page():
    stored = {path.stem for path in (ROOT / "benchmarks" / "results").glob("*.json")}
    assert stored and stored <= set(benchmark_page.KNOWN)


def test_a_benchmark_stores_date_machine_and_versions():
    import record  # benchmark_page has put its folder on the path

    about = record.measured_with()
    assert set(about) >= {"date", "machine", "processor", "cores", "python", "varint", "casadi", "numpy"}
    assert all(about.values()) and re.fullmatch(r"\d{4}-\d\d-\d\d", about["date"])
