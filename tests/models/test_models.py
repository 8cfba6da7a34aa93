"""What every model of the catalogue must satisfy: it runs, keeps its invariants, and follows its
closed form.
"""

from functools import cache

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint import models

pytestmark = pytest.mark.filterwarnings("ignore:the Lagrangian is degenerate")
MOST_STEPS = 400
FINER = {
    "fpu_chain": 2,
    "toda_chain": 2,
    "lennard_jones": 2,
    "outer_solar_system": 4,
    "solar_system": 2,
    "spring_cluster": 4,
}
SCENES = {name: factory().system.structure for name, factory in models.catalogue.items()}
REGULAR = [name for name, scene in SCENES.items() if not (scene.degenerate or scene.nonholonomic)]
DEGENERATE = [name for name, scene in SCENES.items() if scene.degenerate]
CLOSED = [name for name in REGULAR if models.catalogue[name]().exact is not None]


@cache
def run(name):
    """The model and a run of it so accurate that only round-off is left."""
    model = models.catalogue[name]()
    many = model.system.structure.n > 6 and model.system.structure.explicit
    held = model.system.structure.constraints or model.system.structure.contacts
    rule = vi.composition("kahan-li8") if many else vi.lobatto(7) if held else vi.gauss(6)
    start = model.start
    h = model.h / FINER.get(name, 1)
    steps = min(round(start.pop("duration") / h), MOST_STEPS)
    return model, vi.simulate(model.system, rule, **start | {"h": h}, steps=steps)


def sensitivity(system, expression):
    """Σ |∂J/∂y_i y_i| over the state y: what J's round-off is measured against."""
    y = ca.vertcat(system.q, system.v)
    return ca.sum2(
        ca.fabs(ca.jacobian(ca.vec(expression), y)) * ca.repmat(ca.fabs(y).T, expression.numel(), 1)
    )


@pytest.mark.parametrize("name", models.catalogue)
def test_a_model_is_complete_and_starts_in_one_call(name):
    model = models.catalogue[name]()
    assert model.name == name
    assert model.claim.endswith(".") and len(model.source) > 8
    assert abs(model.duration / model.h - round(model.duration / model.h)) < 1e-9
    start = {key: value for key, value in model.start.items() if key != "duration"}
    motion = vi.simulate(model.system, **start, steps=3)
    assert np.isfinite(motion.q).all()


@pytest.mark.parametrize("name", [n for n in REGULAR if models.catalogue[n]().invariants])
def test_invariants_are_conserved_to_round_off(name):
    model, motion = run(name)
    for what, expression in model.invariants.items():
        value = motion.value(expression).reshape(len(motion), -1)
        size = (
            motion.value(sensitivity(model.system, expression)).reshape(len(motion), -1).max(axis=0)
        )
        drift = np.abs(value - value[0]).max(axis=0)
        assert (drift <= 1e-13 * size).all(), (what, drift / size)


@pytest.mark.parametrize("name", CLOSED)
def test_the_simulation_follows_the_closed_form(name):
    model, motion = run(name)
    q, v = model.exact(motion.t)
    for found, exact in ((motion.q, q), (motion.v, v)):
        assert np.abs(found - exact).max() <= 5e-13 * np.abs(exact).max()


@pytest.mark.parametrize("name", CLOSED)
def test_the_closed_form_starts_where_the_model_starts(name):
    model = models.catalogue[name]()
    q, v = model.exact(0.0)
    later = np.abs(model.exact(np.linspace(0, model.duration, 20))).max(axis=(1, 2))
    assert np.abs(q[0] - model.q0).max() <= 1e-14 * later[0]
    assert np.abs(v[0] - model.v0).max() <= 1e-14 * later[1]


@pytest.mark.parametrize("name", DEGENERATE)
def test_degenerate_models_keep_their_energy_in_bounds_of_second_order(name):
    model = models.catalogue[name]()

    def spread(h):
        motion = vi.simulate(model.system, vi.midpoint(), q0=model.q0, h=h, duration=100 * model.h)
        return np.abs(motion.energy - motion.energy[0]).max()

    assert 1.85 < np.log2(spread(model.h / 8) / spread(model.h / 16)) < 2.15


@pytest.mark.parametrize("name", DEGENERATE)
def test_degenerate_models_start_with_the_velocity_of_their_equations(name):
    model = models.catalogue[name]()
    h = 1e-3
    motion = vi.simulate(model.system, vi.midpoint(), q0=model.q0, h=h, steps=1)
    back = vi.simulate(model.system, vi.midpoint(), q0=model.q0, h=-h, steps=1)
    slope = (motion.q[1] - back.q[1]) / (2 * h)
    assert np.abs(slope - model.v0).max() < 20 * h**2 * np.abs(model.v0).max()


def test_parameters_given_to_a_run_act_like_those_given_to_the_factory():
    model, other = models.pendulum(), models.pendulum(length=2.0, g=1.62)
    motion = vi.simulate(
        model.system, vi.gauss(6), **model.start, params={"length": 2.0, "g": 1.62}
    )
    assert np.abs(motion.q - other.exact(motion.t)[0]).max() < 1e-12


def test_a_start_of_the_wrong_size_is_refused():
    with pytest.raises(
        vi.InputError, match="q0 of the model isotropic_oscillator must be 3 finite numbers"
    ):
        models.isotropic_oscillator(q0=(1.0, 2.0))


def test_motions_without_a_closed_form_say_so():
    with pytest.raises(vi.InputError, match="no ellipse"):
        models.rosette(thetadot0=9.0).exact(1.0)
    with pytest.raises(vi.InputError, match="separatrix"):
        models.pendulum(theta0=0.0, thetadot0=2 * np.sqrt(9.81)).exact(1.0)
    with pytest.raises(vi.InputError, match="escapes"):
        models.inverse_distance_field(v0=(0.0, 1.5)).exact(1.0)


@pytest.mark.parametrize("factory", [models.kepler, models.two_body])
def test_only_ellipses_are_built_from_their_elements(factory):
    with pytest.raises(vi.InputError, match="eccentricity"):
        factory(e=1.0)


def test_singular_euler_angles_are_refused():
    with pytest.raises(vi.InputError, match="Euler angles are singular"):
        models.free_rigid_body(omega0=(0.0, 0.0, 1.0))
