"""Sphinx extension: pages of tutorial and course and the gallery's examples as notebooks, from the
same source, and a link to each on its page.
"""

from __future__ import annotations

import ast
import re
import shutil
import zipfile
from pathlib import Path

import jupytext
import nbformat
from blocks import ANSWER, FIGURE, FILM
from docutils import nodes
from gallery import EXAMPLES, example, lagrangian
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook
from sphinx.transforms import SphinxTransform
from state import write_if_changed

FOLDERS = ("tutorial", "course")
LINK = re.compile(r"(?<!!)\[([^\]]+)\]\((?!https?:)[^)]+\)")
BESIDE = re.compile(r"Path\(__file__\)\.parent / \"([\w.]+)\"")
CHECKED = re.compile(r"course\.check\(\"[\d.]+\", (\w+)\)")
NEEDS = (
    '*A page of varint\'s documentation. It needs* `pip install "varint-mechanics[notebook]"`*. Run '
    "the cells from top to bottom.*"
)
KERNEL = {"display_name": "Python 3", "language": "python", "name": "python3"}
ARCHIVE = "varint-notebooks.zip"


def from_page(markdown: str) -> nbformat.NotebookNode:
    """A page as a notebook: links within the documentation as words, answers left out."""
    notebook = jupytext.reads(LINK.sub(r"\1", markdown), fmt="md")
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.source = without_answer(FILM.sub("", FIGURE.sub("", cell.source)).strip())
    notebook.cells.insert(1, new_markdown_cell(NEEDS))
    return finished(notebook)


def without_answer(code: str) -> str:
    """An exercise's code with nothing where its answer stands."""
    checked = CHECKED.search(code)
    return ANSWER.sub(f"{checked[1]} = None  # your answer\n", code) if checked else code


def from_example(path: Path) -> nbformat.NotebookNode:
    """An example as a notebook: what it says, its functions, and the body of `main` paragraph by
    paragraph, where the figure is drawn in one cell.
    """
    it, tree = example(path), ast.parse(path.read_text(encoding="utf-8"))
    lines = it.code.splitlines()
    cells = [
        new_markdown_cell(f"# {it.title}\n\n{it.lead}"),
        new_markdown_cell(NEEDS),
        new_markdown_cell(f"{lagrangian(it)}**Claim.** {it.claim}\n\n*Source:* {it.source}"),
    ]
    main = next(x for x in tree.body if isinstance(x, ast.FunctionDef) and x.name == "main")
    # functions that stand below `main` come before it in a notebook
    above = [x for x in tree.body[1:] if x is not main and not isinstance(x, ast.If)]
    cells += [new_code_cell(text) for text in paragraphs(lines, above, tree.body[0].end_lineno)]
    kept = [x for x in main.body if not writes_the_picture(ast.unparse(x))]
    body = paragraphs(lines, kept, main.body[0].lineno - 1, indent=4)
    drawing = next((k for k, text in enumerate(body) if "plt." in text), len(body))
    if drawing == len(body) and "figure = " in body[-1]:
        body[-1] += "\nfigure"  # what a method has drawn shows as a value
    body = [*body[:drawing], "\n\n".join(body[drawing:])]
    given = zip(main.args.args[1:], main.args.defaults[1:], strict=True)
    body[0] = "".join(f"{x.arg} = {ast.unparse(value)}\n" for x, value in given) + body[0]
    if any(name.id == "out" for x in kept for name in ast.walk(x) if isinstance(name, ast.Name)):
        body[0] = f'out = Path("out")\nout.mkdir(exist_ok=True)\n{body[0]}'
    cells += [new_code_cell(text) for text in body if text]
    for cell in cells:
        cell.source = BESIDE.sub(lambda found: _text_of(path.parent / found[1]), cell.source)
    return finished(new_notebook(cells=cells))


def _text_of(file: Path) -> str:
    """A file that an example reads from beside it as a string of a notebook, which has none."""
    return f'"""{file.read_text(encoding="utf-8")}"""'


def writes_the_picture(statement: str) -> bool:
    """Whether a statement only puts the figure into a file, which a notebook shows instead."""
    return bool(re.match(r"out\.mkdir\(|figure\.savefig\(", statement))


def paragraphs(lines: list[str], statements: list, after: int, indent: int = 0) -> list[str]:
    """The statements' text, one paragraph for what stands without a blank line between; comments
    stay with the statement below.
    """
    found: list[str] = []
    for statement in statements:
        first = min(
            [statement.lineno, *(x.lineno for x in getattr(statement, "decorator_list", []))]
        )
        while first - 2 >= after and lines[first - 2].strip().startswith("#"):
            first -= 1
        text = "\n".join(line[indent:] for line in lines[first - 1 : statement.end_lineno])
        apart = not found or not lines[first - 2].strip() or first - 1 == after
        found = [*found, text] if apart else [*found[:-1], f"{found[-1]}\n{text}"]
    return found


def finished(notebook: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """With a kernel, and names of cells that are the same in every build."""
    notebook.metadata = nbformat.from_dict({"kernelspec": KERNEL})
    notebook.nbformat, notebook.nbformat_minor = 4, 5
    for k, cell in enumerate(notebook.cells):
        cell.id, cell.metadata = f"cell-{k}", nbformat.from_dict({})
    nbformat.validate(notebook)
    return notebook


def every(docs: Path) -> dict[str, nbformat.NotebookNode]:
    """All notebooks by the name of their page, such as ``course/1-least-action``."""
    pages = sorted(page for folder in FOLDERS for page in (docs / folder).glob("[0-9]*.md"))
    found = {
        f"{page.parent.name}/{page.stem}": from_page(page.read_text(encoding="utf-8"))
        for page in pages
    }
    return found | {
        f"gallery/{path.stem}": from_example(path) for path in sorted(EXAMPLES.glob("*.py"))
    }


def write(app) -> None:
    folder = Path(app.srcdir) / "_build" / "notebooks"
    for name, notebook in every(Path(app.srcdir)).items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        write_if_changed(folder / f"{name}.ipynb", nbformat.writes(notebook) + "\n")


def copy(app, error) -> None:
    """Beside the pages, and all of them in one archive."""
    source, target = Path(app.srcdir) / "_build" / "notebooks", Path(app.outdir) / "notebooks"
    if error is not None or app.builder.format != "html":
        return
    shutil.rmtree(target, ignore_errors=True)
    shutil.copytree(source, target)
    with zipfile.ZipFile(target / ARCHIVE, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(source.rglob("*.ipynb")):
            archive.write(file, file.relative_to(source))


class Link(SphinxTransform):
    """Puts a link to the notebook below a page's title."""

    default_priority = 220

    def apply(self, **_: object) -> None:
        name = self.env.docname
        if (Path(self.env.srcdir) / "_build" / "notebooks" / f"{name}.ipynb").exists():
            title = next(iter(self.document.findall(nodes.title)), None)
            if title is not None:
                words = f'<a href="../notebooks/{name}.ipynb" download>This page as a notebook</a>'
                at = title.parent.index(title) + 1
                title.parent.insert(
                    at, nodes.raw("", f'<p class="notebook">{words}</p>', format="html")
                )


def setup(app):
    app.connect("builder-inited", write, priority=400)  # before pages are read
    app.connect("build-finished", copy)
    app.add_transform(Link)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
