"""Notebooks come from the pages and examples, lack the answers, and run."""

import os
import re
import sys
from pathlib import Path

import pytest
from test_examples import skip_without_data

pytest.importorskip("jupytext", reason="makes the notebooks")
nbformat = pytest.importorskip("nbformat")
pytest.importorskip("docutils")
pytest.importorskip("sphinx", reason="links pages with their notebooks")

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
sys.path.insert(0, str(DOCS / "_tools"))

import notebooks  # noqa: E402  (only findable now)

EVERY = notebooks.every(DOCS)
WAITS = 300  # seconds for a cell


def code(notebook):
    return [cell.source for cell in notebook.cells if cell.cell_type == "code"]


def test_every_page_of_tutorial_and_course_and_every_example_is_a_notebook():
    pages = {
        f"{page.parent.name}/{page.stem}"
        for folder in ("tutorial", "course")
        for page in (DOCS / folder).glob("*.md")
        if page.stem != "index"
    }
    examples = {f"gallery/{path.stem}" for path in (ROOT / "examples").glob("*.py")}
    assert set(EVERY) == pages | examples
    assert len([name for name in EVERY if name.startswith("course/")]) == 8


@pytest.mark.parametrize("name", EVERY)
def test_a_notebook_is_well_formed_and_the_same_in_every_build(name):
    notebook = EVERY[name]
    nbformat.validate(notebook)
    kinds = [cell.cell_type for cell in notebook.cells]
    assert kinds[0] == "markdown" and notebook.cells[0].source.startswith("# ")
    assert kinds.count("code") >= 2
    assert not any(cell.get("outputs") for cell in notebook.cells)
    for text in code(notebook):
        compile(text, name, "exec")
        assert not re.search(r"^# (figure|film|answer|end of answer)", text, re.M)
    words = "\n".join(cell.source for cell in notebook.cells if cell.cell_type == "markdown")
    assert not re.search(r"\]\((?!https)", words)  # links that lead nowhere outside the pages
    assert notebook.cells[-1].id == f"cell-{len(notebook.cells) - 1}"


@pytest.mark.parametrize("name", [name for name in EVERY if name.startswith("course/")])
def test_exercises_come_without_their_answers(name):
    text = "\n".join(code(EVERY[name]))
    asked = re.findall(
        r'^(\w+) = None  # your answer\nprint\(vi.course.check\("[\d.]+", (\w+)\)\)$', text, re.M
    )
    assert len(asked) == text.count("course.check(") == 2
    assert all(given == checked for given, checked in asked)


def test_the_answer_alone_is_left_out():
    block = 'x = 1\n# answer\nx = 2\n# end of answer\nprint(course.check("1.1", x))'
    page = f"# T\n\n```python\n{block}\n```\n"
    [cell] = code(notebooks.from_page(page))
    assert cell == 'x = 1\nx = None  # your answer\nprint(course.check("1.1", x))'


def test_an_example_keeps_its_comments_and_draws_in_one_cell(tmp_path):
    path = tmp_path / "scene.py"
    path.write_text(
        '"""Scene: what it is.\n\nClaim: it holds.\nSource: a book.\nRun: python scene.py\n"""\n\n'
        "import sys\nfrom pathlib import Path\n\nN = 3\n\n\n# why\ndef f(x):\n    return x\n\n\n"
        'def main(out: Path = Path("out")) -> None:\n    a = f(N)\n    # one more\n    b = a\n\n'
        "    figure = plt.figure()\n\n    figure.gca().plot([a, b])\n"
        '    out.mkdir(exist_ok=True)\n    figure.savefig(out / "scene.png")\n\n\n'
        'if __name__ == "__main__":\n    main()\n'
    )
    assert code(notebooks.from_example(path)) == [
        "import sys\nfrom pathlib import Path",
        "N = 3",
        "# why\ndef f(x):\n    return x",
        "a = f(N)\n# one more\nb = a",
        "figure = plt.figure()\n\nfigure.gca().plot([a, b])",
    ]


def test_what_an_example_takes_and_reads_stands_in_its_notebook():
    assert "days = 200000.0\n" in "".join(code(EVERY["gallery/planets"]))
    [text] = [x for x in code(EVERY["gallery/six_axis_arm"]) if "URDF = " in x]
    assert "__file__" not in text and '<robot name="' in text


@pytest.mark.parametrize("name", ["course/4-constraints", "gallery/predator_prey"])
def test_some_notebooks_run(name, tmp_path, monkeypatch, capsys):
    """The others do so under `long`, in kernels of their own."""
    monkeypatch.chdir(tmp_path)
    namespace = {"__name__": "notebook"}
    for text in code(EVERY[name]):
        exec(compile(text, name, "exec"), namespace)
    printed = capsys.readouterr().out
    awaiting = printed.count("awaits your answer")
    assert awaiting == (2 if name.startswith("course/") else 0)
    assert printed.count("\n") > awaiting


def run(notebook, folder):
    """The notebook as a kernel leaves it, with the figures of notebooks."""
    client = pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    environment = {name: x for name, x in os.environ.items() if name != "MPLBACKEND"}
    paths = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    runner = client.NotebookClient(notebook, timeout=WAITS, kernel_name="python3")
    runner.execute(cwd=str(folder), env=environment | {"PYTHONPATH": paths})
    return notebook


def outputs(notebook):
    return [out for cell in notebook.cells for out in cell.get("outputs", ())]


@pytest.mark.long
@pytest.mark.parametrize("name", EVERY)
def test_every_notebook_runs_in_a_kernel(name, tmp_path):
    skip_without_data(name.removeprefix("gallery/"))
    done = run(nbformat.from_dict(EVERY[name]), tmp_path)
    kinds = {kind for out in outputs(done) for kind in out.get("data", ())}
    drawing = any("plt.subplots" in text or ".plot(" in text for text in code(EVERY[name]))
    assert "image/png" in kinds or not drawing
    warned = [out.text for out in outputs(done) if out.get("name") == "stderr"]
    assert not [text for text in warned if "Warning" in text]
    if "gallery" not in name and ".animate(" in "".join(code(EVERY[name])):
        films = [out.data.get("text/html", "") for out in outputs(done) if "data" in out]
        assert any('src="data:image/gif;base64,' in text for text in films)


@pytest.mark.long
def test_progress_bars_in_notebooks_are_widgets(tmp_path):
    pytest.importorskip("ipywidgets")
    cell = nbformat.v4.new_code_cell(
        "import varint as vi\nm = vi.models.double_pendulum()\n"
        "motion = vi.simulate(m.system, **m.start, progress=True)"
    )
    done = run(nbformat.v4.new_notebook(cells=[cell]), tmp_path)
    kinds = {kind for out in outputs(done) for kind in out.get("data", ())}
    assert "application/vnd.jupyter.widget-view+json" in kinds
