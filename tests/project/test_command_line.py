"""The command line lists, runs, checks and measures models, and says in one line what was wrong."""

import subprocess
import sys

import numpy as np
import pytest

import varint as vi
from varint.__main__ import main
from varint.command_line.arguments import rule


def test_list_names_every_model_with_its_claim(capsys):
    assert main(["list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == [
        *vi.models.catalogue,
        *vi.models.control_catalogue,
    ]
    assert all(len(line) > 40 for line in lines)


def test_run_writes_the_motion_that_it_reports(tmp_path, capsys):
    figure, file = tmp_path / "new" / "a.png", tmp_path / "a.npz"
    words = ["run", "pendulum", "--rule", "gauss(4)", "--h", "0.05", "--duration", "3"]
    assert main([*words, "--plot", str(figure), "--save", str(file)]) == 0
    motion, model = vi.load(file), vi.models.pendulum()
    assert (
        str(motion.rule) == "gauss(4)" and motion.h == 0.05 and motion.t[-1] == pytest.approx(3.0)
    )
    error = np.abs(motion.q - model.exact(motion.t)[0]).max()
    printed = capsys.readouterr().out
    assert f"differs from the exact motion by {error:.1e}" in printed and error < 1e-8
    assert figure.read_bytes()[:4] == b"\x89PNG" and f"wrote {figure}" in printed


def test_run_prints_events_and_animates(tmp_path, capsys):
    film = tmp_path / "ladder.gif"
    assert main(["run", "bouncing_ball", "--duration", "0.5", "--animate", str(film)]) == 0
    assert "impact at t = " in capsys.readouterr().out
    assert film.read_bytes()[:3] == b"GIF"


def test_a_very_short_motion_becomes_a_film_of_ten_seconds_unless_a_speed_is_given(
    tmp_path, capsys
):
    from PIL import Image

    for words, seconds in (([], 10.0), (["--speed", "0.5"], 1.0)):
        film = tmp_path / "film.gif"
        assert (
            main(
                [
                    "run",
                    "pendulum",
                    "--h",
                    "0.01",
                    "--duration",
                    "0.5",
                    "--animate",
                    str(film),
                    *words,
                ]
            )
            == 0
        )
        with Image.open(film) as frames:
            assert 0.04 * (frames.n_frames - 1) == pytest.approx(seconds, abs=0.05)
    assert "a second of the film is 0.05 of the motion's time" in capsys.readouterr().out


def test_run_solves_an_optimal_control_problem_and_prints_its_cost(tmp_path, capsys):
    figure = tmp_path / "a.png"
    assert main(["run", "rest_to_rest", "--plot", str(figure)]) == 0
    assert "cost found 12   known 12" in capsys.readouterr().out and figure.exists()
    assert main(["run", "rest_to_rest", "--h", "0.1"]) == 2
    assert main(["check", "rest_to_rest"]) == 2
    assert capsys.readouterr().err.count("varint: rest_to_rest") == 2


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
    [
        ("gauss(3)", "gauss(3)"),
        ("lobatto(3)", "lobatto(3)"),
        ("midpoint", str(vi.midpoint())),
        ("blanes-moan6", "composition('blanes-moan6')"),
        ("composition('verlet')", "composition('verlet')"),
    ],
)
def test_rules_are_read_from_their_names(text, name):
    assert str(rule(text)) == name


@pytest.mark.parametrize(
    "text", ["rk4", "gauss", "gauss(0)", "gauss(two)", "__import__('os')", "midpoint(3)"]
)
def test_what_is_no_rule_is_refused(text, capsys):
    with pytest.raises(SystemExit) as stop:
        main(["run", "pendulum", "--rule", text])
    assert stop.value.code == 2 and "argument --rule" in capsys.readouterr().err


def test_a_wrong_name_gets_the_nearest_ones_and_no_traceback(capsys):
    assert main(["run", "pendlum"]) == 2
    error = capsys.readouterr().err
    assert (
        error.startswith("varint: unknown model 'pendlum'; did you mean pendulum")
        and "Traceback" not in error
    )


def test_it_is_run_as_a_module():
    done = subprocess.run(
        [sys.executable, "-m", "varint", "list"], capture_output=True, text=True, check=True
    )
    assert "double_pendulum" in done.stdout


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("--h 0", "0 is no positive number"),
        ("--h -0.1", "no positive number"),
        ("--duration nan", "no positive number"),
        ("--h x", "x is no positive number"),
        ("--plot a.foo", "a.foo must end in .png"),
        ("--animate a.avi", "a.avi must end in .gif"),
        ("--save a", "a must end in .npz"),
    ],
)
def test_what_cannot_be_done_is_refused_before_anything_runs(words, says, capsys):
    with pytest.raises(SystemExit) as stop:
        main(["run", "pendulum", *words.split()])
    printed = capsys.readouterr()
    assert stop.value.code == 2 and says in printed.err and not printed.out


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("run pendulum --h 100", "a step of 100 is longer than the motion"),
        ("bench knife_edge", "nothing to compare"),
        ("run lotka_volterra --animate a.gif", "has no sketch"),
        ("bench lotka_volterra", "nothing to compare"),
    ],
)
def test_what_a_model_does_not_allow_is_said_in_one_line(words, says, capsys):
    assert main(words.split()) == 2
    printed = capsys.readouterr()
    assert (
        printed.err.startswith("varint: ")
        and says in printed.err
        and len(printed.err.splitlines()) == 1
    )
    assert not printed.out


def test_a_file_that_cannot_be_written_is_said_in_one_line(tmp_path, capsys):
    (tmp_path / "taken").write_text("")
    assert (
        main(["run", "pendulum", "--duration", "0.1", "--plot", str(tmp_path / "taken" / "a.png")])
        == 2
    )
    assert capsys.readouterr().err.startswith("varint: ")


@pytest.mark.parametrize(
    ("words", "h"),
    [("--h 0.3 --duration 1", 0.25), ("--h 0.3", 20 / 67), ("--duration 0.39", None)],
)
def test_the_motion_ends_when_it_was_asked_to_and_steps_that_fit_are_said(
    words, h, tmp_path, capsys
):
    file = tmp_path / "a.npz"
    assert main(["run", "pendulum", *words.split(), "--save", str(file)]) == 0
    motion, model = vi.load(file), vi.models.pendulum()
    assert motion.t[-1] == pytest.approx(0.39 if h is None else round(motion.t[-1]), rel=1e-12)
    assert motion.h == pytest.approx(h or 0.39 / np.ceil(0.39 / model.h), rel=1e-12)
    assert f"of {motion.h:.6g}" in capsys.readouterr().out


def test_steps_that_fit_are_taken_without_a_word(tmp_path, capsys):
    file = tmp_path / "a.npz"
    assert main(["run", "pendulum", "--h", "0.1", "--duration", "0.3", "--save", str(file)]) == 0
    assert vi.load(file).h == 0.1 or abs(vi.load(file).h / 0.1 - 1) < 1e-15
    assert "do not fit" not in capsys.readouterr().out


def test_arguments_of_a_model_can_be_set(tmp_path, capsys):
    file = tmp_path / "a.npz"
    words = ["--set", "length=2", "--set", "theta0=0.3", "--duration", "2", "--save", str(file)]
    assert main(["run", "pendulum", *words]) == 0
    motion, model = vi.load(file), vi.models.pendulum(length=2.0, theta0=0.3)
    assert np.abs(motion.q - model.exact(motion.t)[0]).max() < 1e-8
    assert "differs from the exact motion" in capsys.readouterr().out


def test_parameters_of_the_scene_can_be_set_that_its_model_does_not_take(tmp_path):
    file = tmp_path / "a.npz"
    assert (
        main(["run", "figure_eight", "--set", "G=1.1", "--duration", "1", "--save", str(file)]) == 0
    )
    model = vi.models.figure_eight()
    start = dict(q0=model.q0, v0=model.v0, h=vi.load(file).h, duration=1.0)
    direct = vi.simulate(model.system, params=dict(G=1.1), **start)
    assert np.array_equal(vi.load(file).q, direct.q)


def test_single_coordinates_and_velocities_of_the_start_can_be_set(tmp_path, capsys):
    file = tmp_path / "a.npz"
    words = ["--set", "m=1,3", "--start", "q0=0.1,0.2", "--start", "theta1=1"]
    words += ["--start", "theta2_dot=2", "--duration", "0.5", "--save", str(file)]
    assert main(["run", "double_pendulum", *words]) == 0
    motion = vi.load(file)
    assert motion.q[0].tolist() == [1, 0.2] and motion.v[0] == pytest.approx([0, 2])
    assert "differs from the exact motion" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("pendulum --set lenght=2", "pendulum has no lenght; it has theta0, thetadot0, m, length"),
        ("pendulum --set length=1,2", "length is one number such as 1.0"),
        ("double_pendulum --set m=1", "m is 2 numbers such as (1.0, 1.0)"),
        ("chain_pendulum --set links=2.5", "links is a whole number such as 5"),
        ("central_force --set potential=1", "potential is no number"),
        ("pendulum --start phi=1", "or one of theta (velocities with _dot)"),
        ("pendulum --start theta=1,2", "is no start of pendulum"),
        ("pendulum --start q0=1,2", "must be 1 finite numbers"),
        ("rest_to_rest --start q0=1", "comes with its own start"),
    ],
)
def test_settings_that_a_model_does_not_have_are_refused_with_those_it_has(words, says, capsys):
    assert main(["run", *words.split()]) == 2
    printed = capsys.readouterr()
    assert says in printed.err and len(printed.err.splitlines()) == 1 and not printed.out


@pytest.mark.parametrize("words", ["length", "length=x", "=2", "2=3"])
def test_what_is_no_setting_is_refused(words, capsys):
    with pytest.raises(SystemExit) as stop:
        main(["run", "pendulum", "--set", words])
    assert stop.value.code == 2 and "argument --set" in capsys.readouterr().err


def test_a_reader_that_has_seen_enough_is_no_error():
    with subprocess.Popen(
        [sys.executable, "-m", "varint", "list"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as run:
        assert run.stdout is not None and run.stderr is not None
        run.stdout.readline()
        run.stdout.close()
        assert run.stderr.read() == b""
        assert run.wait() == 0


def test_a_film_shows_its_progress_where_someone_watches(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("varint.numerics.progress._is_watched", lambda: True)
    monkeypatch.setattr("varint.numerics.progress.PATIENCE", 0.0)
    film = tmp_path / "film.gif"
    assert main(["run", "pendulum", "--duration", "8", "--animate", str(film)]) == 0  # some looks
    assert "/201" in (said := capsys.readouterr().err) and "film.gif" in said


def test_without_a_command_it_tells_which_there_are(capsys):
    assert main([]) == 0
    text = capsys.readouterr().out
    assert all(command in text for command in ("list", "run", "check", "bench"))
