"""What is said about the project holds: the README's code runs, versions agree, the demo does
what it claims.
"""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from references import entries

import varint as vi
from varint.rules.compositions import COMPOSITIONS

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def module(path: str):
    """A file of the project that is not part of the package, as a module."""
    spec = importlib.util.spec_from_file_location(Path(path).stem, ROOT / path)
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found


def test_files_named_in_the_readme_exist():
    links = re.findall(r"\]\(([^)#]+)\)", README)
    assert links
    assert all(link.startswith("http") or (ROOT / link).exists() for link in links)


def test_the_readme_names_every_composition():
    assert all(f"`{name}`" in README for name in COMPOSITIONS)


def test_versions_agree():
    project = re.search(r'^version = "(.+)"$', (ROOT / "pyproject.toml").read_text(), re.MULTILINE)[
        1
    ]
    citation = re.search(
        r"^version: (.+)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE
    )[1]
    assert project == citation == vi.__version__


def test_public_names_exist_and_are_sorted():
    assert sorted(vi.__all__) == list(vi.__all__) and all(hasattr(vi, name) for name in vi.__all__)


@pytest.mark.parametrize("arguments", [[], ["sing"]])
def test_tasks_without_a_known_task_say_which_there_are(arguments):
    ran = subprocess.run(
        [sys.executable, ROOT / "tasks.py", *arguments], capture_output=True, text=True, check=False
    )
    assert ran.returncode == 1
    assert all(f"  {task}" in ran.stderr for task in ("demo", "test", "bench", "docs"))


def test_the_demo_starts_from_the_published_data_and_is_measured_against_the_reference():
    published = entries("c")["C_outer_solar_system"]
    demo, model = module("examples/outer_solar_system.py"), vi.models.outer_solar_system()
    row = published["reference"]["state"][published["times"].index(demo.DAYS)]
    assert np.array_equal(demo.REFERENCE.ravel(), row[:18])
    assert np.array_equal(model.q0, published["initial"]["q"]) and np.array_equal(
        model.v0, published["initial"]["v"]
    )
    assert np.array_equal(model.system.defaults["m"].ravel(), published["params"]["m"])
    assert model.system.defaults["G"] == published["params"]["G"]


def test_the_demo_reaches_the_reference(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    demo = module("examples/outer_solar_system.py")
    demo.main()
    rows = [
        line.split()
        for line in capsys.readouterr().out.splitlines()
        if line.startswith("composition")
    ]
    *drifts, error = np.array([[float(x) for x in row[-4:]] for row in rows]).T
    assert (error < [4e-12, 9e-10, 1.5e-2]).all()
    energy, momentum, angular_momentum = drifts
    assert (energy < [1e-14, 6e-14, 1.5e-6]).all()
    assert (momentum < 1e-14).all() and (angular_momentum < 1e-14).all()
    assert (tmp_path / "out/outer_solar_system.png").stat().st_size > 10_000
    again = vi.load(tmp_path / "out/outer_solar_system.npz")
    assert np.abs(again.q[-1].reshape(-1, 3) - demo.REFERENCE).max() < 5e-12
