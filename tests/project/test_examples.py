"""Every example runs without a display or a warning, draws its picture, and finds what it says
is exact.
"""

import re
import runpy
from importlib.metadata import PackageNotFoundError, distributions
from pathlib import Path

import matplotlib.figure
import pytest

import varint as vi

EXAMPLES = sorted((Path(__file__).parents[2] / "examples").glob("*.py"))
LINE = re.compile(r"found\s+(-?[\d.]+(?:e-?\d+)?)\s+(exact|theory)\s+(-?[\d.]+(?:e-?\d+)?)")
# relative; "theory" is a leading order or an order of convergence
CLOSE = {
    "exact": 1e-6,
    "theory": 0.05,
}


# data that come as packages, and their fits take some ten seconds
PLANS = {"six_axis_arm", "crane_and_leap", "quadruped", "control_films"}
# of many scenes, each of them arranged anew, or of many searches
MANY = {
    "arenstorf",
    "charged_particle",
    "figure_eight",
    "halo_orbits",
    "pendulum_paths",
    "rotating_frame",
}
DATA = {"exoplanets": "radvel", "solar_system_masses": "skyfield-data"}


def is_long(path: Path) -> bool:
    """What compiles a controller takes three seconds, so do plans of several bodies."""
    return path.stem.endswith("_in_c") or path.stem in {*PLANS, *MANY, *DATA}


RUN = [pytest.param(path, marks=pytest.mark.long) if is_long(path) else path for path in EXAMPLES]


def skip_without_data(name: str) -> None:
    needed = [DATA[name]] if name in DATA else []
    missing = [x for x in needed if not list(distributions(name=x))]
    if missing:
        pytest.skip(f"needs {missing[0]}: pip install 'varint-mechanics[data]'")


@pytest.mark.parametrize("path", RUN, ids=lambda path: path.stem)
def test_an_example_finds_what_it_claims_and_draws_it(path, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    skip_without_data(path.stem)
    main = runpy.run_path(str(path))["main"]
    saved = matplotlib.figure.Figure.savefig

    def small(self, name, **given):
        return saved(self, name, **(given if "format" in given else {"dpi": 40}))

    # frames of films keep their size
    monkeypatch.setattr(matplotlib.figure.Figure, "savefig", small)
    animate = vi.Trajectory.animate
    few = lambda self, path, **given: animate(self, path, **(given | {"fps": 2}))  # noqa: E731
    monkeypatch.setattr(vi.Trajectory, "animate", few)
    main()
    pictures = list((tmp_path / "out").glob("*.png"))
    assert [picture.stem for picture in pictures] == [path.stem]
    assert pictures[0].stat().st_size > 5000
    text = capsys.readouterr().out
    pairs = LINE.findall(text)
    assert pairs or path.stem == "outer_solar_system", text  # its table has an error column instead
    for found, kind, value in pairs:
        assert float(found) == pytest.approx(float(value), rel=CLOSE[kind]), text


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_states_its_claim_and_source(path):
    text = path.read_text()
    assert "\nClaim: " in text and "\nSource: " in text and "\nRun: python" in text
    assert 60 <= len(text.splitlines()) <= 120


@pytest.mark.long
def test_masses_of_the_solar_system_are_within_1e_5_of_the_published(tmp_path, monkeypatch, capsys):
    skip_without_data("solar_system_masses")
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(EXAMPLES[0].with_name("solar_system_masses.py")))["main"]()
    [largest] = re.findall(r"largest error (\S+),", capsys.readouterr().out)
    assert float(largest) < 1e-5


@pytest.mark.long
def test_exoplanets_are_what_is_likeliest_by_radvel_and_periods_within_the_published_errors(
    tmp_path, monkeypatch, capsys
):
    skip_without_data("exoplanets")
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(EXAMPLES[0].with_name("exoplanets.py")))["main"]()
    text = capsys.readouterr().out
    beside = dict(re.findall(r"^(\w+) .*radvel \S+: ([-+][\d.]+) σ", text, re.MULTILINE))
    assert len(beside) == 9 and all(abs(float(x)) < 0.5 for x in beside.values())
    assert all(abs(float(x)) < 0.1 for name, x in beside.items() if name[:5] != "noise")
    off = dict(re.findall(r"^(\w+) .*: ([-+][\d.]+) of it$", text, re.MULTILINE))
    assert all(abs(float(x)) < 1 for name, x in off.items() if name not in ("K_c", "e_c"))
    [far] = re.findall(r"χ² is ([\d.]+) more", text)
    assert float(far) < 1.5**2  # standard deviations of the likelihood, to the published e_c


@pytest.mark.parametrize("name", sorted(DATA))
def test_an_example_without_its_data_says_what_to_install(name, monkeypatch):
    main = runpy.run_path(str(EXAMPLES[0].with_name(f"{name}.py")))["main"]

    def nothing(package: str) -> None:
        raise PackageNotFoundError(package)

    monkeypatch.setitem(main.__globals__, "distribution", nothing)
    with pytest.raises(SystemExit, match=r"This example reads .* pip install"):
        main()
