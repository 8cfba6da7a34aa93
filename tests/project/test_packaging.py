"""The distribution: what it says of itself, its command, and that its tests come with it."""

from __future__ import annotations

import importlib
import os
import re
import subprocess
import sys
import tarfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PROJECT = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
BUILD = (
    "from setuptools import build_meta; print(build_meta.build_sdist(__import__('sys').argv[1]))"
)


def test_the_command_is_a_function_that_returns_an_exit_code():
    where = re.search(r'^varint = "([\w.]+):(\w+)"$', PROJECT, re.MULTILINE)
    assert where is not None
    function = getattr(importlib.import_module(where[1]), where[2])
    assert function([]) == 0


def test_the_project_says_who_made_it_for_what_and_where_it_runs():
    assert re.search(r'^authors = \[\{ name = "\w', PROJECT, re.MULTILINE)
    assert "[project.urls]" in PROJECT and "Operating System :: POSIX :: Linux" in PROJECT
    oldest = re.search(r'^requires-python = ">=(3\.\d+)"$', PROJECT, re.MULTILINE)[1]
    named = re.findall(r"Python :: (3\.\d+)", PROJECT)
    assert named[0] == oldest and named == sorted(named, key=lambda x: int(x[2:]))


def test_the_source_distribution_contains_what_its_tests_need(tmp_path):
    pytest.importorskip("setuptools", minversion="77", reason="the project's build needs it")
    git = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False)
    if git.returncode:
        pytest.skip("not in a repository: this is such a distribution already")
    source = tmp_path / "source"
    for name in git.stdout.splitlines():
        if (ROOT / name).is_file():
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            (source / name).write_bytes((ROOT / name).read_bytes())
    subprocess.run(
        [sys.executable, "-c", BUILD, str(tmp_path)], cwd=source, capture_output=True, check=True
    )
    (archive,) = tmp_path.glob("*.tar.gz")
    with tarfile.open(archive) as packed:
        packed.extractall(tmp_path / "out", filter="data")
    (unpacked,) = (tmp_path / "out").iterdir()
    tracked = {name for name in git.stdout.splitlines() if (ROOT / name).is_file()}
    lost = {name for name in tracked if not (unpacked / name).exists()}
    assert all(name.startswith(".") for name in lost)  # what git and its runners need
    collected = subprocess.run(
        [sys.executable, "-m", "pytest", "--collect-only", "-q", "-p", "no:cacheprovider", "tests"],
        cwd=unpacked,
        env={**os.environ, "PYTHONPATH": str(unpacked)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert collected.returncode == 0, collected.stdout[-2000:] + collected.stderr[-2000:]


def test_every_recipe_and_record_has_the_version():
    version = re.search(r'^version = "(.+)"$', PROJECT, re.MULTILINE)[1]
    recipe = (ROOT / "conda" / "meta.yaml").read_text(encoding="utf-8")
    assert re.search(r'set version = "(.+?)"', recipe)[1] == version
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    dated = dict(re.findall(r"^## \[([\d.]+)\] - (\d{4}-\d\d-\d\d)$", changes, re.MULTILINE))
    assert next(iter(dated)) == version
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"date-released: {dated[version]}" in citation


def test_conda_and_pip_need_the_same():
    recipe = (ROOT / "conda" / "meta.yaml").read_text(encoding="utf-8")
    run = re.search(r"^  run:\n((?:    - .+\n)+)", recipe, re.MULTILINE)[1]
    conda = {line.strip("- ").replace(" ", "").replace("-base", "") for line in run.splitlines()}
    pip = set(
        re.findall(r'"([^"]+)"', re.search(r"^dependencies = (.+)$", PROJECT, re.MULTILINE)[1])
    )
    python = re.search(r'^requires-python = "(.+)"$', PROJECT, re.MULTILINE)[1]
    assert conda == pip | {f"python{python}"}


def test_wheels_are_built_for_every_python_that_is_named():
    named = set(re.findall(r"Python :: (3\.\d+)", PROJECT))
    built = re.search(r'^build = "(.+)"$', PROJECT, re.MULTILINE)[1]
    assert {f"3.{x}" for x in re.findall(r"cp3(\d+)-\*", built)} == named


def test_the_paper_cites_what_it_lists_and_lists_what_it_cites():
    paper = (ROOT / "paper.md").read_text(encoding="utf-8")
    library = (ROOT / "paper.bib").read_text(encoding="utf-8")
    keys = re.findall(r"^@\w+\{(\w+),$", library, re.MULTILINE)
    assert len(keys) == len(set(keys)) == library.count("doi = {10.")
    assert set(re.findall(r"@(\w+)", paper)) == set(keys)
    for heading in ("Summary", "Statement of need", "State of the field", "References"):
        assert f"\n# {heading}\n" in paper
    gallery = len(list((ROOT / "examples").glob("*.py")))
    assert f"A gallery of {gallery} scenes" in paper


def test_what_is_promised_about_names_counts_the_public_ones():
    """The page names the modules whose members are public: all that are reached by name."""
    page = (ROOT / "docs" / "stability.md").read_text(encoding="utf-8")
    varint = importlib.import_module("varint")
    for name in varint._LATER_MODULES:
        assert f"`varint.{name}`" in page
        assert importlib.import_module(f"varint.{name}").__all__


def test_an_installation_is_tried_by_what_the_readme_says():
    tried = (ROOT / ".ci" / "try_installation.py").read_text(encoding="utf-8")
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    [six] = re.findall(r"```python\n(import casadi.*?motion = .*?)\nmotion\.plot", readme, re.S)[:1]
    assert six in tried
