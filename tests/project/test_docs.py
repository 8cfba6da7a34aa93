"""Every Python block of README and documentation runs; pictures have words; links in the project
lead somewhere.
"""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from urllib.parse import urlsplit

import pytest

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
sys.path[:0] = [str(DOCS), str(DOCS / "_tools"), str(ROOT / "benchmarks")]

import benchmark_page  # noqa: E402  (only findable now)
import images  # noqa: E402
from blocks import FIGURE, marked_blocks, outcome, python_blocks  # noqa: E402  (only findable now)
from chapters import CHAPTERS  # noqa: E402
from gallery import example  # noqa: E402
from tools import record  # noqa: E402

import varint as vi  # noqa: E402
from varint.rules.compositions import COMPOSITIONS  # noqa: E402

GENERATED = {DOCS / "verification.md", DOCS / "benchmarks.md", *(DOCS / "gallery").glob("*.md")}
PAGES = sorted({*ROOT.glob("*.md"), *DOCS.glob("*.md"), *DOCS.glob("*/*.md")} - GENERATED)
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
MADE = re.compile(r"^(?:\.\./)?(?:gallery/\w+|verification|benchmarks)\.md$")  # by the build


def name_of(page):
    return str(page.relative_to(ROOT))


@pytest.mark.parametrize(
    "page", [page for page in PAGES if python_blocks(page.read_text())], ids=name_of
)
def test_every_python_block_runs(page):
    namespace = {"__name__": "page"}
    for number, code in enumerate(python_blocks(page.read_text(encoding="utf-8"))):
        if re.search(r"vi\.(equations|from_sympy)\(|import sympy", code):
            pytest.importorskip("sympy", reason="needs the extra varint-mechanics[sympy]")
        if "cc -std=c99" in code and not shutil.which("cc"):
            pytest.skip("needs a C compiler")
        # GitHub shows no comment as a caption: README has its picture below the block
        if page.parent == ROOT:
            code = code.replace("motion.plot()", "motion.plot()\n# figure: below")
        outcome(code, namespace, f"{name_of(page)}, block {number}", draw=False)


SCRIPTS = [
    (page, code)
    for page in PAGES
    for kind, code in marked_blocks(page.read_text("utf-8"))
    if kind == "script"
]


@pytest.mark.parametrize(
    ("page", "code"), SCRIPTS, ids=lambda x: name_of(x) if isinstance(x, Path) else ""
)
def test_every_script_runs_as_a_file(page, code, tmp_path):
    (tmp_path / "script.py").write_text(code, encoding="utf-8")
    environment = os.environ | {"PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"}
    command = [sys.executable, "-W", "error", "script.py"]
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout


def test_there_is_no_python_that_does_not_run_but_for_tools_that_pip_does_not_install():
    fences = re.compile(r"^ *```+ *(\{code-block\} *)?python\b", re.M)
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        marked = [kind for kind, _ in marked_blocks(text)]
        assert len(fences.findall(text)) == len(python_blocks(text)) + len(marked), page
        # test_coming_from.py
        allowed = {"still", "illustration"} if page.name == "coming-from.md" else {"script"}
        assert set(marked) <= allowed, page
        assert not re.search(r"^```\s*\n(?=import |from )", text, re.M), (
            f"{page}: Python without a language"
        )


COMMAND = re.compile(r"python -m varint ((?:list|run|check|bench)\b[^`|\n]*)")
COMMANDS = sorted(
    {found.strip() for page in PAGES for found in COMMAND.findall(page.read_text("utf-8"))}
)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_of_the_pages_runs(command, tmp_path, monkeypatch, capsys):
    from varint import __main__ as shell

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(shell, "STEPS", (16, 32))  # of a benchmark: that it runs, not how fast
    words = shlex.split(command)
    simulated = words[1:] and words[1] in shell.vi.models.catalogue and "--duration" not in words
    assert shell.main(words + ["--duration", "1"] * bool(simulated)) == 0
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
    drawn = outcome(
        "import matplotlib.pyplot as plt; plt.plot([1, 2])\n# figure: a line", kept, "here"
    ).figures
    import matplotlib.pyplot as plt

    before = plt.rcParams["axes.prop_cycle"]
    outcome("plt.style.use('tableau-colorblind10')", kept, "here")
    outcome(
        "assert plt.rcParams['axes.prop_cycle'].by_key()['color'][0] == '#006BA4'", kept, "here"
    )
    assert plt.rcParams["axes.prop_cycle"] == before  # of another page
    assert drawn[0][0] == "a line" and drawn[0][1].startswith(b"\x89PNG")


LINK = re.compile(r"(!?)\[([^\]]*)\]\((<[^>]+>|[^)\s]+)\)")


def links(page):
    """(! or nothing, words, target) of the links of a page, outside code."""
    text = re.sub(r"```.*?```|`[^`\n]*`", "", page.read_text(encoding="utf-8"), flags=re.S)
    return [(bang, words, target.strip("<>")) for bang, words, target in LINK.findall(text)]


def anchors(page):
    """Names that a page's headings can be linked by."""
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.S)
    headings = re.findall(r"^#+ (.+)$", text, re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_lead_to_files_and_headings_and_pictures_have_words(page):
    for bang, words, target in links(page):
        assert not bang or len(words) > 10, f"{target} needs a description"
        path, _, anchor = target.partition("#")
        if re.match(r"\w+:", path) or MADE.match(path):
            continue
        file = page.parent / path if path else page
        assert file.exists(), f"{name_of(page)} links to {target}"
        assert not anchor or anchor in anchors(file), f"{name_of(page)} links to {target}"


def test_links_that_lead_outside_are_well_formed_and_the_documentation_has_those_of_the_readme():
    outside = {page: {t for _, _, t in links(page) if re.match(r"\w+:", t)} for page in PAGES}
    # what linkcheck tries
    known = set().union(*(found for page, found in outside.items() if DOCS in page.parents))
    assert outside[ROOT / "README.md"] <= known
    for target in set().union(*outside.values()):
        parts = urlsplit(target)
        assert (
            parts.scheme == "https" and "." in parts.netloc and not re.search(r"[\s<>\"]", target)
        ), target
        if parts.netloc == "doi.org":
            assert re.fullmatch(r"/10\.\d{4,9}/\S+", parts.path), target


def test_a_doi_is_written_as_it_is_linked_and_as_it_is_cited():
    found = {t: words for _, words, t in links(DOCS / "theory" / "literature.md") if "doi.org" in t}
    assert len(found) > 10 and all(
        words == "doi:" + t.removeprefix("https://doi.org/") for t, words in found.items()
    )
    cited = re.findall(r"^ +doi: (\S+)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.M)
    assert cited and {f"https://doi.org/{doi}" for doi in cited} <= set(found)


def test_a_picture_without_words_is_found_while_the_documentation_is_built():
    nodes, utils = pytest.importorskip("docutils.nodes"), pytest.importorskip("docutils.utils")
    pytest.importorskip("sphinx")
    from alternatives import wordless

    page = utils.new_document("page")
    page += nodes.image(uri="good.png", alt="a line that rises from left to right")
    page += nodes.raw("", '<img src="good.png" alt="two circles, one in the other">', format="html")
    assert not wordless(page)
    page += [
        nodes.image(uri="bad.png"),
        nodes.raw("", '<img src="worse.png" alt="">', format="html"),
    ]
    assert wordless(page) == ["bad.png", '<img src="worse.png" alt="">']


def test_figures_of_the_pages_are_described_in_whole_sentences():
    words = [w for page in PAGES for w in FIGURE.findall(page.read_text(encoding="utf-8"))]
    assert len(words) > 10
    assert all(len(w) > 40 and w.endswith(".") for w in words)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_has_what_the_gallery_shows(path):
    it = example(path)
    assert it.title and len(it.claim) > 30 and len(it.source) > 5
    first = " ".join(it.code.split('"""')[1].split("\n\n")[0].split())  # it may take two lines
    assert f"{it.title}: {it.lead}".lower().rstrip(": ") == first.lower().removesuffix(
        "." if not it.lead else ""
    )


def test_every_chapter_of_the_gallery_has_examples_and_none_twice():
    names = [name for chapter in CHAPTERS.values() for name in chapter]
    assert len(names) == len(set(names))
    there = {path.stem for path in EXAMPLES}
    assert all(there & set(chapter) for chapter in CHAPTERS.values())


def test_every_page_is_in_a_table_of_contents():
    listed = set()
    for page in DOCS.rglob("*.md"):
        for body in re.findall(r"```\{toctree\}\n(.*?)```", page.read_text(encoding="utf-8"), re.S):
            entries = [
                line.strip()
                for line in body.splitlines()
                if line.strip() and not line.startswith(":")
            ]
            listed |= {(page.parent / entry).with_suffix(".md").resolve() for entry in entries}
    pages = {page for page in PAGES if DOCS in page.parents} - {
        DOCS / "index.md",
        DOCS / "known_limits.md",
    }
    assert not {name_of(page) for page in pages - listed}


def test_the_benchmark_page_shows_what_was_measured_when_and_on_what_and_says_what_was_not(
    tmp_path,
):
    rows = [
        {
            "wanted": 1e-6,
            "tool": "varint",
            "seconds": 0.0005,
            "error": 3e-7,
            "setting": "gauss(8)",
            "setup": 0.1,
        },
        {
            "wanted": 1e-6,
            "tool": "peer",
            "seconds": 0.001,
            "error": 8e-7,
            "setting": "",
            "setup": 0.0,
        },
        {
            "wanted": 1e-9,
            "tool": "peer",
            "seconds": 0.002,
            "error": 8e-10,
            "setting": "",
            "setup": 0.0,
        },
    ]
    ratios = [{"ratio": 0.5, "scene": "comet", "wanted": 1e-6, "measure": "q", "long": True}]
    about = {"date": "2026-01-31", "processor": "abacus", "cores": 3, "varint": "9.9"}
    scenes = {"comet": {"apart": 1e-14, "rows": rows, "all": rows, "setup": {}}}
    results = tmp_path / "results"
    results.mkdir()
    whole = {
        "measured_with": about,
        "scenes": scenes,
        "geometric means": {"error of q": 0.5},
        "ratios": ratios,
    }
    (results / "work_precision.json").write_text(json.dumps(whole))
    (results / "long_run.json").write_text(
        json.dumps({"rows": [{"steps": 10**8, "drift": -1.25e-7, "none": None}]})
    )
    page = tmp_path / "page" / "benchmarks.md"
    benchmark_page.write(page, results)
    text = page.read_text()
    assert (
        "Measured on abacus, 3 cores, 2026-01-31, varint 9.9." in text
        and "date not recorded" in text
    )
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


def test_a_scene_that_is_measured_anew_replaces_its_rows_and_no_others():
    def rows(scene, *times):
        return [{"scene": scene, "ms": x} for x in times]

    stored = [*rows("first", 1, 2), *rows("third", 5, 6)]
    scenes = ["first", "second", "third"]
    with_second = record.with_scene(stored, rows("second", 3, 4), scenes)
    assert [row["ms"] for row in with_second] == [1, 2, 3, 4, 5, 6]
    again = record.with_scene(with_second, rows("first", 7, 8), scenes)
    assert [row["ms"] for row in again] == [7, 8, 3, 4, 5, 6]


def test_a_benchmark_stores_date_machine_and_versions():
    about = record.measured_with()
    assert set(about) >= {
        "date",
        "machine",
        "processor",
        "cores",
        "python",
        "varint",
        "casadi",
        "numpy",
    }
    assert all(about.values()) and re.fullmatch(r"\d{4}-\d\d-\d\d", about["date"])


def test_the_readme_lists_the_rules_that_there_are():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    for family in (vi.gauss, vi.lobatto):
        last = int(re.search(rf"`{family.__name__}\(s\)`, s = \d+ … (\d+);", text)[1])
        assert family(last)
        with pytest.raises(vi.InputError):
            family(last + 1)
    (row,) = re.findall(r"^\| `composition\(name\)`.*$", text, re.M)
    assert set(re.findall(r"`([a-z-]+\d*)`", row)) == set(COMPOSITIONS)


def test_the_readme_s_run_times_are_those_of_the_benchmark():
    def scene(**seconds):
        return {
            "rows": [
                {"tool": tool, "wanted": images.WANTED, "seconds": s} for tool, s in seconds.items()
            ]
        }

    first, second, *_ = images.SHOWN
    about = {"processor": "abacus", "date": "2026-01-31"}
    result = {
        "measured_with": about,
        "scenes": {first: scene(varint=0.002, peer=0.003), second: scene(varint=0.0005)},
    }
    rows = [
        [cell.strip() for cell in line.split("|")[1:-1]]
        for line in images.measured(result).splitlines()[:4]
    ]
    assert rows[0][1:] == [images.SHOWN[first], images.SHOWN[second]]
    assert rows[2:] == [["varint", "2 ms", "0.5 ms"], ["peer", "1.5", "–"]]
    assert "abacus, 2026-01-31" in images.measured(result)
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    found = images.BETWEEN.search(text)
    assert found and re.search(r"\d{4}-\d\d-\d\d", found[0]) and "| heyoka |" in found[0]


def test_the_lines_under_the_headings_of_docstrings_stand_alone():
    torn = re.compile(r"^ *(-{4,}|={4,}) +[^-= ].*$", re.M)
    sources = sorted((ROOT / "varint").rglob("*.py"))
    found = {str(path): torn.findall(path.read_text(encoding="utf-8")) for path in sources}
    assert len(sources) > 200 and not any(found.values()), found
