"""The command line lists, runs, checks and measures models, and says in one line what was wrong."""

import subprocess
import sys

import numpy as np
import pytest

import varint as vi
from varint.__main__ import main, rule


def test_list_names_every_model_with_its_claim(capsys):
    assert main(["list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(vi.models.catalogue)
    assert all(len(line) > 40 for line in lines)


def test_run_writes_the_motion_that_it_reports(tmp_path, capsys):
    figure, file = tmp_path / "new" / "a.png", tmp_path / "a.npz"
    words = ["run", "pendulum", "--rule", "gauss(4)", "--h", "0.05", "--duration", "3"]
    assert main([*words, "--plot", str(figure), "--save", str(file)]) == 0
    motion, model = vi.load(file), vi.models.pendulum()
    assert str(motion.rule) == "gauss(4)" and motion.h == 0.05 and motion.t[-1] == pytest.approx(3.0)
    error = np.abs(motion.q - model.exact(motion.t)[0]).max()
    printed = capsys.readouterr().out
    assert f"differs from the exact motion by {error:.1e}" in printed and error < 1e-8
    assert figure.read_bytes()[:4] == b"\x89PNG" and f"wrote {figure}" in printed


def test_run_prints_events_and_animates(tmp_path, capsys):
    film = tmp_path / "ladder.gif"
    assert main(["run", "bouncing_ball", "--duration", "0.5", "--animate", str(film)]) == 0
    assert "impact at t = " in capsys.readouterr().out
    assert film.read_bytes()[:3] == b"GIF"


def test_check_passes_on_a_good_rule_and_reports_the_order(capsys):
    assert main(["check", "pendulum", "--rule", "gauss(2)", "--h", "0.05"]) == 0
    text = capsys.readouterr().out
    assert "gauss(2): all hold" in text and "order 4.0" in text


def test_check_fails_with_a_step_that_resolves_nothing(capsys):
    assert main(["check", "pendulum", "--rule", "verlet", "--h", "0.5"]) == 1
    printed = capsys.readouterr()
    assert "NOT all hold" in printed.out
    assert printed.err.startswith("varint: the energy went from") and "Warning" not in printed.err


def test_bench_names_the_cheapest_rule(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("varint.__main__.STEPS", (32, 64))
    assert main(["bench", "pendulum", "--duration", "1", "--plot", str(tmp_path / "b.png")]) == 0
    text = capsys.readouterr().out
    assert "cheapest for an error of" in text and "composition('verlet')" in text
    assert (tmp_path / "b.png").exists()


@pytest.mark.parametrize(
    ("text", "name"),
    [("gauss(3)", "gauss(3)"), ("lobatto(3)", "lobatto(3)"), ("midpoint", str(vi.midpoint())),
     ("blanes-moan6", "composition('blanes-moan6')"), ("composition('verlet')", "composition('verlet')")],
)  # fmt: skip
def test_rules_are_read_from_their_names(text, name):
    assert str(rule(text)) == name


@pytest.mark.parametrize("text", ["rk4", "gauss", "gauss(0)", "gauss(two)", "__import__('os')", "midpoint(3)"])
def test_what_is_no_rule_is_refused(text, capsys):
    with pytest.raises(SystemExit) as stop:
        main(["run", "pendulum", "--rule", text])
    assert stop.value.code == 2 and "argument --rule" in capsys.readouterr().err


def test_a_wrong_name_gets_the_nearest_ones_and_no_traceback(capsys):
    assert main(["run", "pendlum"]) == 2
    error = capsys.readouterr().err
    assert error.startswith("varint: unknown model 'pendlum'; did you mean pendulum") and "Traceback" not in error


def test_it_is_run_as_a_module():
    done = subprocess.run([sys.executable, "-m", "varint", "list"], capture_output=True, text=True, check=True)
    assert "double_pendulum" in done.stdout
