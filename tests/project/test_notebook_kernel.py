"""A real kernel runs cells as a reader does: what they show, and what they say besides."""

import io
import os
import re
from base64 import b64decode
from pathlib import Path

import pytest
from PIL import Image

nbclient = pytest.importorskip("nbclient")
nbformat = pytest.importorskip("nbformat")
pytest.importorskip("ipykernel")
pytest.importorskip("matplotlib_inline")

ROOT = Path(__file__).resolve().parents[2]
CELLS = {
    "scene": "import varint as vi\nmodel = vi.models.kepler()",
    "run": "motion = vi.simulate(model.system, **model.start | {'duration': 2}, progress=True)",
    "plot": "motion.plot()",
    "shown twice": "figure = motion.plot()\nfigure",
    "kept": "figure = motion.plot()",
    "film": "motion.animate(speed=0.5, fps=10)",
    "film kept": "film = motion.animate(speed=0.5, fps=10)",
    "motion": "motion",
    "many": "many = vi.ensemble(model.system, q0=[model.q0] * 9, v0=model.v0, h=0.01, steps=400,"
    " progress=True)\nmany.plot()",
    "conserved": "motion.conserved().plot()",
}


@pytest.fixture(scope="module")
def outputs():
    """(type, kinds or stream) of every output of each cell."""
    cells = [nbformat.v4.new_code_cell(text) for text in CELLS.values()]
    book = nbformat.v4.new_notebook(cells=cells)
    book.metadata["kernelspec"] = {"name": "python3", "display_name": "", "language": "python"}
    client = nbclient.NotebookClient(book, timeout=120, kernel_name="python3")
    without = {name: x for name, x in os.environ.items() if name != "MPLBACKEND"}
    client.execute(env=without | {"PYTHONPATH": str(ROOT)})
    return {name: cell.outputs for name, cell in zip(CELLS, book.cells, strict=True)}


def pictures(outs):
    return [x for x in outs if "image/png" in x.get("data", {})]


@pytest.mark.long
@pytest.mark.parametrize("cell", ["plot", "shown twice", "many", "conserved"])
def test_a_figure_shows_once(outputs, cell):
    assert len(pictures(outputs[cell])) == 1


@pytest.mark.long
def test_a_figure_that_is_kept_shows_not_at_all(outputs):
    assert not pictures(outputs["kept"]) and not pictures(outputs["film kept"])


@pytest.mark.long
def test_a_film_plays_and_leaves_no_empty_frame(outputs):
    """Besides, a bar tells how far its pictures are."""
    assert not pictures(outputs["film"])
    (film,) = [x for x in outputs["film"] if x["output_type"] == "execute_result"]
    gif = re.search('data:image/gif;base64,([^"]+)', film["data"]["text/html"])
    assert Image.open(io.BytesIO(b64decode(gif[1]))).n_frames > 10


@pytest.mark.long
def test_a_motion_shows_as_a_table_with_its_curves(outputs):
    (shown,) = outputs["motion"]
    assert "<img" in shown["data"]["text/html"]


@pytest.mark.long
def test_nothing_warns(outputs):
    said = [x["text"] for outs in outputs.values() for x in outs if x["output_type"] == "stream"]
    assert not [text for text in said if "Warning" in text or "IProgress" in text]
