"""Every example runs without a display or a warning, draws its picture, and finds what it says
is exact.
"""

import re
import runpy
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


# what compiles a controller takes the compiler three seconds, so do plans of several bodies
PLANS = {"six_axis_arm", "crane_and_leap"}
RUN = [
    pytest.param(path, marks=pytest.mark.long)
    if path.stem.endswith("_in_c") or path.stem in PLANS
    else path
    for path in EXAMPLES
]


@pytest.mark.parametrize("path", RUN, ids=lambda path: path.stem)
def test_an_example_finds_what_it_claims_and_draws_it(path, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
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
