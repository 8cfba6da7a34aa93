"""The tools around the package: benchmarks run without their helpers, pages run once, references
list what is public.
"""

from __future__ import annotations

import ast
import importlib
import sys
from pathlib import Path

import pytest

import varint as vi

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "docs" / "_tools"))

import page_runs  # noqa: E402  (only findable now)
import reference_page  # noqa: E402
import state  # noqa: E402

BENCHMARKS = sorted((ROOT / "benchmarks").glob("*.py"))


@pytest.mark.parametrize("path", BENCHMARKS, ids=lambda path: path.stem)
def test_what_the_task_runs_are_benchmarks_and_no_helpers(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    runs = [node for node in tree.body if isinstance(node, ast.If)]
    assert any("__main__" in ast.unparse(node.test) for node in runs)
    helpers = {helper.stem for helper in BENCHMARKS} - {path.stem}
    imported = {
        (node.module or "") if isinstance(node, ast.ImportFrom) else node.names[0].name
        for node in ast.walk(tree)
        if isinstance(node, (ast.Import, ast.ImportFrom))
    }
    assert not imported & helpers


def test_a_page_is_executed_once_until_its_code_changes(tmp_path, capsys):
    codes = ["import varint as vi\nx = 2", "print(x * 21)"]
    first = page_runs.outcomes(codes, "page", tmp_path)
    assert [x.text for x in first] == ["", "42\n"]
    assert "executed page: 2 blocks" in capsys.readouterr().err
    assert page_runs.outcomes(codes, "page", tmp_path) == first
    assert not capsys.readouterr().err
    again = page_runs.outcomes([codes[0], "print(x)"], "page", tmp_path)
    assert again[1].text == "2\n" and "executed page" in capsys.readouterr().err


def test_an_interrupted_build_leaves_no_torn_file(tmp_path, monkeypatch):
    """What is kept is there whole or not at all: a torn page would end every later build."""

    def half(path, text, **given):
        with path.open("w") as file:
            file.write(text[: len(text) // 2])
        raise KeyboardInterrupt

    codes = ["print(6 * 7)"]
    with monkeypatch.context() as interrupted:
        interrupted.setattr(Path, "write_text", half)
        with pytest.raises(KeyboardInterrupt):
            page_runs.outcomes(codes, "page", tmp_path)
    assert [x.text for x in page_runs.outcomes(codes, "page", tmp_path)] == ["42\n"]


def test_pictures_are_kept_as_they_were_drawn(tmp_path):
    codes = ["import matplotlib.pyplot as plt\nplt.plot([0, 1])\n# figure: a line upwards"]
    first = page_runs.outcomes(codes, "page", tmp_path)
    assert page_runs.outcomes(codes, "page", tmp_path) == first
    assert first[0].figures[0][1][:4] == b"\x89PNG"


def test_a_page_that_fails_is_not_kept(tmp_path):
    for _ in range(2):
        with pytest.raises(page_runs.PageError, match="ZeroDivisionError") as error:
            page_runs.outcomes(["x = 1", "x / 0"], "page", tmp_path)
        assert error.value.block == 1


def test_comments_and_docstrings_do_not_count_as_changes():
    before = 'def f(x):\n    """One."""\n    return x  # why\n'
    assert state.code_only(before) == state.code_only('def f(x):\n    """Two."""\n    return x')
    assert state.code_only(before) != state.code_only('def f(x):\n    """One."""\n    return 2 * x')


def test_internals_of_public_classes_exist_and_are_left_out_of_the_reference(tmp_path):
    reference_page.write(tmp_path / "reference.rst")
    text = (tmp_path / "reference.rst").read_text(encoding="utf-8")
    for name, internals in reference_page.INTERNAL.items():
        for member in internals:
            assert hasattr(getattr(vi, name), member), (name, member)
            assert not member.startswith("_")
        entry = text.partition(f".. autoclass:: varint.{name}\n")[2].partition("\n\n")[0]
        assert f":exclude-members: {', '.join(internals)}" in entry


def test_fields_of_a_named_tuple_are_described_once(tmp_path):
    reference_page.write(tmp_path / "reference.rst")
    text = (tmp_path / "reference.rst").read_text(encoding="utf-8")
    entry = text.partition(".. autoclass:: varint.Equations\n")[2].partition("\n\n")[0]
    assert all(f", {field}" in entry for field in vi.Equations._fields)
    assert "latex" not in entry and "\n   :members:\n" in f"\n{entry}"


def test_a_colon_in_the_first_line_of_a_property_ends_no_type():
    pytest.importorskip("sphinx")
    from docstrings import process, restore
    from sphinx.ext.napoleon import Config, NumpyDocstring

    lines = ["Momentum: the slope of L, p = ∂L/∂v."]
    process(None, "property", "momentum", None, None, lines)
    config = Config(napoleon_use_rtype=False)
    lines = str(NumpyDocstring(lines, config, what="property", name="momentum")).splitlines()
    restore(None, "property", "momentum", None, None, lines)
    assert "\n".join(lines).strip() == "Momentum: the slope of L, p = ∂L/∂v."


def test_helpers_of_benchmarks_import_from_their_folder(monkeypatch):
    pytest.importorskip("scipy")
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    fronts = importlib.import_module("tools.fronts")
    record = importlib.import_module("tools.record")
    assert fronts.RESULT.parent == record.FOLDER == ROOT / "benchmarks" / "results"
