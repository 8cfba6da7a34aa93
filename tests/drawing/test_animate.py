"""Films last as long as they say, show the points where they are, and refuse what cannot be
shown.
"""

import re
from base64 import b64decode
from io import BytesIO

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib import animation
from matplotlib.backend_bases import FigureCanvasBase
from PIL import Image

import varint as vi
from varint.drawing.animation import frame_times


@pytest.fixture(scope="module")
def swing():
    model = vi.models.pendulum()
    motion = vi.simulate(model.system, vi.gauss(4), q0=model.q0, v0=model.v0, h=0.05, duration=2.0)
    return model, motion


@pytest.mark.parametrize(("speed", "fps"), [(1.0, 5.0), (4.0, 30.0), (0.5, 8.0)])
def test_a_gif_lasts_as_long_as_the_motion_divided_by_the_speed(swing, tmp_path, speed, fps):
    model, motion = swing
    motion = motion.at(np.linspace(0.0, 0.8, 9))
    motion.animate(tmp_path / "film.gif", sketch=vi.models.sketch(model), speed=speed, fps=fps)
    with Image.open(tmp_path / "film.gif") as film:
        lengths = []
        for frame in range(film.n_frames):
            film.seek(frame)
            lengths.append(film.info["duration"] / 1000)
    assert sum(lengths[:-1]) == pytest.approx(0.8 / speed, abs=lengths[0])


def test_frames_are_true_to_time_and_the_first_shows_the_start(swing):
    _, motion = swing
    times = frame_times(motion, 0.5, 1 / 25)
    assert np.allclose(np.diff(times), 0.02) and times[0] == 0.0 and times[-1] == pytest.approx(2.0)
    backwards = vi.simulate(motion.system, vi.gauss(2), q0=1.0, v0=0.0, h=-0.1, steps=10)
    assert np.allclose(frame_times(backwards, 1.0, 0.1), -0.1 * np.arange(11))


def test_a_frame_shows_the_points_where_the_motion_is(swing):
    model, motion = swing
    film = motion.animate(sketch=vi.models.sketch(model), fps=10)
    axes = film._fig.axes[0]
    for frame in (0, 7, 20):
        film._func(frame)
        theta = model.exact(frame / 10)[0][0, 0]
        bob = [line.get_xydata()[-1] for line in axes.lines if len(line.get_xydata())]
        wanted = np.array([np.sin(theta), -np.cos(theta)])
        assert min(np.abs(place - wanted).max() for place in bob) < 1e-6
        assert axes.get_title() == f"t = {frame / 10:.2f}"


@pytest.mark.parametrize("name", ["double_pendulum", "heavy_top"])
def test_a_frame_of_a_file_looks_like_the_same_frame_drawn_in_full(name, tmp_path):
    model = vi.models.catalogue[name]()
    motion = vi.simulate(model.system, **model.start | {"duration": 0.4, "h": 0.01})
    sketch = vi.models.sketch(model)
    motion.animate(tmp_path / "film.gif", sketch=sketch, fps=10)
    film = motion.animate(sketch=sketch, fps=10)
    film._func(3)
    film._fig.canvas.draw()
    whole = np.asarray(film._fig.canvas.buffer_rgba())[..., :3].astype(float)
    with Image.open(tmp_path / "film.gif") as file:
        file.seek(3)
        frame = np.asarray(file.convert("RGB")).astype(float)
    differs = np.abs(frame - whole).max(axis=2) > 60  # a GIF has 256 colours
    assert frame.shape == whole.shape and differs.mean() < 1e-3
    assert (np.abs(whole - 255).max(axis=2) > 60).mean() > 0.01  # there is something to see


def test_a_trace_of_given_length_forgets_the_older_past(swing):
    model, motion = swing
    short = motion.animate(sketch=vi.models.sketch(model), fps=10, trace=0.2)
    whole = motion.animate(sketch=vi.models.sketch(model), fps=10)
    lengths = []
    for film in (short, whole):
        film._func(20)
        lengths.append(max(len(line.get_xydata()) for line in film._fig.axes[0].lines))
    assert lengths[0] < 0.25 * lengths[1]


def test_html_and_scenes_in_space_are_written(tmp_path):
    model = vi.models.spherical_pendulum_cartesian()
    motion = vi.simulate(model.system, q0=model.q0, v0=model.v0, h=0.05, steps=8)
    motion.animate(tmp_path / "film.html", fps=5)
    assert "image/png;base64" in (tmp_path / "film.html").read_text()


@pytest.mark.skipif(not animation.FFMpegWriter.isAvailable(), reason="needs ffmpeg")
def test_mp4_is_written(swing, tmp_path):
    model, motion = swing
    motion[:5].animate(tmp_path / "film.mp4", sketch=vi.models.sketch(model), fps=10)
    assert (tmp_path / "film.mp4").read_bytes()[4:8] == b"ftyp"


def test_what_cannot_be_shown_is_refused_with_the_remedy(swing, tmp_path, monkeypatch):
    model, motion = swing
    with pytest.raises(
        vi.InputError, match=r"do not say where anything is; give sketch=varint.Sketch"
    ):
        motion.animate()
    drawn = vi.models.sketch(model)
    with pytest.raises(vi.InputError, match=r"ends in .gif, .mp4 or .html"):
        motion.animate(tmp_path / "film.avi", sketch=drawn)
    with pytest.raises(vi.InputError, match=r"cannot write .*: there is no folder .*nowhere"):
        motion.animate(tmp_path / "nowhere" / "film.gif", sketch=drawn)
    with pytest.raises(vi.InputError, match="speed"):
        motion.animate(sketch=drawn, speed=0)
    with pytest.raises(vi.InputError, match="too many"):
        motion.animate(sketch=drawn, speed=1e-6)
    monkeypatch.setattr(animation.FFMpegWriter, "isAvailable", lambda: False)
    with pytest.raises(vi.InputError, match="ffmpeg"):
        motion.animate(tmp_path / "film.mp4", sketch=drawn)
    with pytest.raises(vi.InputError, match="2 coordinates or all have 3"):
        vi.Sketch({"a": [0, 0], "b": [1, 2, 3]})
    with pytest.raises(vi.InputError, match=r"unknown points \['c'\]"):
        vi.Sketch({"a": [0, 0]}, rods=[("a", "c")])
    with pytest.raises(vi.InputError, match="at least one point"):
        vi.Sketch({})
    with pytest.raises(vi.InputError, match="has no sketch"):
        vi.models.sketch(vi.models.lotka_volterra())


def test_cartesian_scenes_need_no_sketch():
    model = vi.models.figure_eight()
    motion = vi.simulate(model.system, q0=model.q0, v0=model.v0, h=0.1, steps=5)
    film = motion.animate(fps=5)
    assert len(film._fig.axes[0].lines) == 6  # a trace and a dot of each body


STRETCHING = {"swinging_atwood", "lengthening_pendulum", "spring_pendulum"}  # no rigid rods
NOWHERE = {"lotka_volterra"}  # numbers of animals have no place


def shown(model):
    """A short motion that moves as the model's does."""
    start = model.start | {"duration": 10 * model.h}
    return vi.simulate(model.system, **start)


@pytest.mark.filterwarnings("ignore:the Lagrangian is degenerate")  # of the guiding centre
@pytest.mark.parametrize("name", sorted(set(vi.models.catalogue) - NOWHERE))
def test_every_model_with_a_place_is_animated_and_its_rods_keep_their_lengths(name):
    model = vi.models.catalogue[name]()
    sketch, motion = vi.models.sketch(model), shown(model)
    if sketch.rods and name not in STRETCHING:
        rods = ca.vertcat(*(ca.norm_2(sketch.points[a] - sketch.points[b]) for a, b in sketch.rods))
        lengths = motion.value(rods).reshape(len(motion), -1)
        assert np.ptp(lengths, axis=0).max() < 1e-9 * lengths.max() and lengths.min() > 1e-3
    film = motion.animate(sketch=sketch, speed=motion.duration, fps=2)
    film._func(2)
    places = np.array([motion.value(sketch.points[mark])[-1] for mark in sketch.marks])
    dots = [line for line in film._fig.axes[0].lines if line.get_marker() == "o"]
    drawn = [line.get_data_3d() if sketch.dimensions == 3 else line.get_xydata().T for line in dots]
    assert np.allclose(np.array(drawn)[:, :, 0], places, atol=1e-9 * max(1.0, np.abs(places).max()))
    plt.close(film._fig)


@pytest.mark.parametrize("name", vi.models.control_catalogue)
def test_every_control_model_has_a_sketch_of_its_scene(name):
    model = vi.models.control_catalogue[name]()
    sketch, phase = vi.models.sketch(model), model.phases[0]
    known = ca.vertcat(phase.system.q, phase.system.t, phase.system.c)
    assert all(
        set(map(str, ca.symvar(x))) <= set(map(str, ca.symvar(known)))
        for x in sketch.points.values()
    )
    if sketch.rods:
        q = np.random.default_rng(1).normal(size=(5, phase.system.q.numel()))
        # only where the constraints hold
        if name in (
            "swing_up_rod",
            "carried_load",
            "carried_load_reduced",
        ):
            q = np.array([phase.start["q"], phase.end["q"]], dtype=float)
        rods = ca.vertcat(*(ca.norm_2(sketch.points[a] - sketch.points[b]) for a, b in sketch.rods))
        length = ca.Function("length", [phase.system.q, phase.system.c], [rods])
        found = np.array([length(x, phase.system.default_vector) for x in q])
        assert np.ptp(found, axis=0).max() < 1e-12


def played(film):
    """The GIF that a notebook shows of a film."""
    return b64decode(re.fullmatch(r'<img .*base64,([^"]+)">', film._repr_html_())[1])


def test_in_a_notebook_a_film_plays_inside(swing, tmp_path):
    model, motion = swing
    few = motion.at(np.linspace(0.0, 0.8, 9))
    few_frames = dict(sketch=vi.models.sketch(model), fps=5)
    with Image.open(BytesIO(played(few.animate(**few_frames)))) as film:
        assert film.n_frames == 5 and film.info["duration"] == 200
    written = few.animate(tmp_path / "film.gif", **few_frames)
    assert played(written) == (tmp_path / "film.gif").read_bytes()


def test_a_film_plays_after_its_figure_was_closed_as_notebooks_do(swing):
    model, motion = swing
    film = motion[:3].animate(sketch=vi.models.sketch(model), fps=10)
    plt.close(film._fig)
    film._fig.set_canvas(FigureCanvasBase(film._fig))  # as newer Matplotlib leaves it
    assert played(film)[:3] == b"GIF"


WRONG = {
    "sketch": (["a", 3, {"bob": [0, 0]}], "sketch must be a varint.Sketch, got"),
    "trace": ([-1, -1e-9, -np.inf], "trace is a length in time, not negative|must be finite"),
    "trace ": (["a", np.nan, [1, 2]], "trace must be"),
    "fps": (["a", None, np.nan, -1, 0], "fps must be"),
    "path": ([3, ["a.gif"]], "path must be the name of a file, got"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_no_argument_of_a_film_is_refused_in_words(swing, name):
    model, motion = swing
    for given in WRONG[name][0]:
        with pytest.raises(vi.InputError, match=WRONG[name][1]):
            motion.animate(**{"sketch": vi.models.sketch(model), name.strip(): given})


def test_traces_of_no_length_and_without_an_end_are_drawn(swing):
    model, motion = swing
    lengths = {}
    for trace in (0.0, 0.5, np.inf, None):
        film = motion.animate(sketch=vi.models.sketch(model), trace=trace)
        film._func(40)
        lengths[trace] = max(len(x.get_xdata()) for x in plt.gcf().axes[0].lines)
        plt.close("all")
    assert lengths[0.0] <= 2 < lengths[0.5] < lengths[None] == lengths[np.inf]


def test_parts_of_a_sketch_that_are_no_lists_are_refused_in_words():
    for part in (dict(rods=3), dict(traces=3), dict(marks=3), dict(rods=[3])):
        with pytest.raises(vi.InputError, match=r"by their names; got rods="):
            vi.Sketch({"a": [0, 0]}, **part)
    with pytest.raises(vi.InputError, match="at least one point"):
        vi.Sketch(3)
