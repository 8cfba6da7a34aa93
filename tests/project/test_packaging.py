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
