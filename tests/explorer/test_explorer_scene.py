"""What lies beneath the explorer's page: knobs, motions and frames."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.explorer.film import LONGEST, SHORTEST, film_of
from varint.explorer.scene import motion_of, scene_of

CATALOGUE = vi.models.catalogue
SHORT = ("pendulum", "double_pendulum", "heavy_top", "atwood", "rolling_disc", "bouncing_ball")


def values(scene) -> dict[str, float]:
    return {knob.name: knob.value for knob in scene.knobs}


def test_a_model_untouched_moves_as_simulate_moves_it():
    model = vi.models.double_pendulum()
    motion = motion_of(scene_of(model), {})
    own = vi.simulate(model.system, **model.start)
    assert np.array_equal(motion.q, own.q)
    assert np.array_equal(motion.t, own.t)


def test_the_knobs_are_parameters_start_and_duration_with_ranges_around_their_values():
    scene = scene_of(vi.models.double_pendulum())
    names = [knob.name for knob in scene.knobs]
    assert names == [
        *("m[0]", "m[1]", "length[0]", "length[1]", "g"),
        *("theta1", "theta2", "theta1_dot", "theta2_dot"),
        "duration",
    ]
    assert all(knob.low <= knob.value <= knob.high for knob in scene.knobs)
    assert all(knob.low > 0 for knob in scene.knobs if knob.group in ("parameters", "time"))


def test_a_turned_knob_is_the_argument_that_it_stands_for():
    model = vi.models.double_pendulum()
    turned = {"m[1]": 2.5, "g": 3.0, "theta2": 1.1, "theta1_dot": -0.7, "duration": 3.0}
    motion = motion_of(scene_of(model), turned)
    own = vi.simulate(
        model.system,
        q0=[model.q0[0], 1.1],
        v0=[-0.7, model.v0[1]],
        h=model.h,
        duration=3.0,
        params=dict(m=[1.0, 2.5], g=3.0),
    )
    assert np.array_equal(motion.q, own.q)
    assert motion.duration == pytest.approx(3.0)


def test_controls_are_knobs_that_hold_a_constant_value():
    model = vi.models.two_link_arm()
    motion = motion_of(scene_of(model), {"torque2": 0.2, "duration": 1.0})
    assert motion.u[:, :, 1] == pytest.approx(0.2)
    own = vi.simulate(model.system, **(model.start | dict(duration=1.0, u=[0.0, 0.2])))
    assert np.array_equal(motion.q, own.q)


def test_a_start_off_the_constraints_is_brought_onto_them():
    scene = scene_of(vi.models.pendulum_cartesian())
    motion = motion_of(scene, {"length": 0.8, "x": 0.5, "y": -0.3})
    assert np.hypot(*motion.q.T) == pytest.approx(0.8, abs=1e-10)


def test_a_motion_is_set_out_from_with_its_own_start_parameters_rule_and_step():
    q, v = vi.coordinates("x1", "y1")
    c = vi.Parameters(k=2.0)
    system = vi.System(q, v, ca.sumsqr(v) / 2 - c.k * ca.sumsqr(q) / 2, params=c)
    start = dict(q0=[1.0, 0.0], v0=[0.0, 0.5], h=0.1, steps=40, t0=0.3, params=dict(k=3.0))
    own = vi.simulate(system, vi.gauss(3), **start)
    scene = scene_of(own)
    assert values(scene)["k"] == 3.0
    assert scene.sketch is not None
    again = motion_of(scene, {})
    assert again.q == pytest.approx(own.q, abs=1e-13)
    assert (again.rule, again.t[0], again.h) == (own.rule, 0.3, own.h)


@pytest.mark.parametrize("name", SHORT)
def test_the_frames_show_the_motion_at_even_times(name):
    model = CATALOGUE[name]()
    scene = scene_of(model)
    motion = motion_of(scene, {"duration": min(model.duration, 3.0)})
    film = film_of(scene, motion)
    assert np.diff(film.t) == pytest.approx(0.04 * film.speed)
    assert film.t[-1] <= motion.t[-1] + 1e-12
    seconds = 0.04 * (len(film.t) - 1)
    assert SHORTEST - 0.05 <= seconds <= LONGEST
    frames = motion.at(film.t)
    assert film.at_frames[:, 0] == pytest.approx(frames.energy)
    assert film.at_frames[:, 1:] == pytest.approx(frames.p)
    assert film.energy == pytest.approx(motion.energy - motion.energy[0], abs=1e-12)
    assert set(film.places) == set(scene.sketch.points)
    for where in film.places.values():
        assert np.abs(where - film.middle).max() <= film.half


def test_rods_in_space_keep_the_length_that_their_direction_to_the_eye_leaves():
    """Places in space are turned and projected: no distance grows, and the vertical shrinks by
    the cosine of the elevation.
    """
    model = vi.models.heavy_top()
    scene = scene_of(model)
    motion = motion_of(scene, {"duration": 2.0})
    film = film_of(scene, motion)
    frames = motion.at(film.t)
    a, b = scene.sketch.rods[0]
    true = frames.value(scene.sketch.points[a] - scene.sketch.points[b])
    seen = film.places[a] - film.places[b]
    assert (np.linalg.norm(seen, axis=1) <= np.linalg.norm(true, axis=1) + 1e-12).all()
    eye = np.array([np.cos(-np.pi / 3), np.sin(-np.pi / 3)]) * np.cos(np.pi / 6)
    depth = true @ [*eye, np.sin(np.pi / 6)]
    assert (seen**2).sum(axis=1) + depth**2 == pytest.approx((true**2).sum(axis=1))
    assert seen[:, 1] + 0.5 * true[:, :2] @ eye / np.cos(np.pi / 6) == pytest.approx(
        true[:, 2] * np.cos(np.pi / 6)
    )


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:the Lagrangian is degenerate")
@pytest.mark.parametrize("name", CATALOGUE)
def test_every_model_can_be_played_with(name):
    scene = scene_of(CATALOGUE[name]())
    motion = motion_of(scene, {})
    film = film_of(scene, motion)
    assert np.isfinite(film.at_frames).all()
    assert all(np.isfinite(where).all() for where in film.places.values())


def test_what_cannot_be_played_with_is_refused():
    with pytest.raises(vi.InputError, match="play takes a model or a motion, got System"):
        scene_of(vi.models.pendulum().system)
    with pytest.raises(vi.InputError, match="play takes a model or a motion, got str"):
        vi.play("pendulum")
    with pytest.raises(vi.InputError, match="sketch takes"):
        vi.play(vi.models.pendulum(), sketch=3)
    arm = vi.models.two_link_arm()
    moved = dict(arm.start, duration=0.03)
    changing = vi.simulate(arm.system, **(moved | dict(u=np.arange(6.0).reshape(3, 2))))
    with pytest.raises(vi.InputError, match="controls are constant"):
        scene_of(changing)
    scene = scene_of(vi.models.pendulum())
    with pytest.raises(vi.InputError, match="called 'lenght'"):
        motion_of(scene, dict(lenght=1.0))
    with pytest.raises(vi.InputError, match="too many to be made anew"):
        motion_of(scene, dict(duration=1e9))
    kepler = vi.models.kepler()
    start = dict(q0=kepler.q0, v0=kepler.v0, h=0.2, steps=5, time_scale="auto")
    with pytest.raises(vi.InputError, match="equal steps"):
        scene_of(vi.simulate(kepler.system, **start))
