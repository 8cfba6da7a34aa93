"""Normal modes against closed forms: with constraints, gyroscopic, damped, free."""

import casadi as ca
import numpy as np
import pytest
from orbit_scenes import double_pendulum_held, springs

import varint as vi
from varint import orbits


def test_the_double_pendulum_has_its_two_modes_in_angles_and_with_constraints():
    squares = 9.81 * np.array([2 - np.sqrt(2), 2 + np.sqrt(2)])
    angles = orbits.normal_modes(vi.models.double_pendulum().system, [0.0, 0.0])
    held = orbits.normal_modes(double_pendulum_held(), [0.0, -1.0, 0.0, -2.0])
    for modes in (angles, held):
        assert modes.frequencies**2 == pytest.approx(squares, rel=1e-14)
        assert modes.signatures == (1, 1) and modes.definite and modes.verdict.startswith("stable")
    assert angles.shapes[:, 0] / angles.shapes[:, 1] == pytest.approx([0.5**0.5, -(0.5**0.5)])
    # rods: x1 = θ1, x2 = θ1 + θ2, nothing up or down
    assert held.shapes[0] == pytest.approx(np.array([1 / (1 + 2**0.5), 0, 1, 0]), abs=1e-14)


def test_a_magnetic_field_splits_an_oscillator_and_makes_shapes_complex():
    q, v = vi.coordinates("x", "y")
    B, w = 0.7, 1.3
    trap = vi.System(q, v, (v.T @ v - w**2 * q.T @ q + B * (q[0] * v[1] - q[1] * v[0])) / 2)
    modes = orbits.normal_modes(trap, [0.0, 0.0])
    middle = np.sqrt(w**2 + B**2 / 4)
    assert modes.frequencies == pytest.approx([middle - B / 2, middle + B / 2], rel=1e-13)
    turn = modes.shapes[:, 1] / modes.shapes[:, 0]
    assert turn == pytest.approx([-1j, 1j], abs=1e-12) or turn == pytest.approx(
        [1j, -1j], abs=1e-12
    )
    assert turn[0] == pytest.approx(turn[1].conjugate(), abs=1e-12)


def test_friction_makes_exponents_complex():
    q, v = vi.coordinates("x")
    damped = vi.System(q, v, (v**2 - 4 * q**2) / 2, force=-0.2 * v)
    modes = orbits.normal_modes(damped, [0.0])
    assert modes.exponents == pytest.approx([-0.1 + 1j * np.sqrt(4 - 0.01)], rel=1e-13)
    assert modes.verdict.startswith("asymptotically stable")


def test_the_drift_of_a_free_molecule_is_divided_out():
    q, v = vi.coordinates("x1", "x2", "x3")
    m, k = [16.0, 12.0, 16.0], 5.0
    kinetic = sum(m[i] * v[i] ** 2 for i in range(3)) / 2
    bonds = k * ((q[1] - q[0] - 1) ** 2 + (q[2] - q[1] - 1) ** 2) / 2
    molecule = vi.System(q, v, kinetic - bonds)
    modes = orbits.normal_modes(molecule, [-1.0, 0.0, 1.0])
    # Landau & Lifshitz, §24, problem 1
    wanted = [np.sqrt(k / 16), np.sqrt(k * (2 * 16 + 12) / (16 * 12))]
    assert modes.frequencies == pytest.approx(wanted, rel=1e-12)
    assert modes.neutral == 0 and modes.verdict.startswith("stable")
    # a particle that nothing holds, in a scene without symmetries, is neutral
    free = springs(4.0, 0.0)
    assert orbits.normal_modes(free, [0.0, 0.0]).frequencies == pytest.approx([2.0])


def test_signs_of_energy_are_told():
    modes = orbits.normal_modes(springs(1.0, 4.0, signs=[1, -1]), [0.0, 0.0])
    assert modes.signatures == (1, -1) and not modes.definite
    assert modes.verdict.startswith("linearly stable")


def test_two_swings_of_one_pitch_are_both_listed():
    system = vi.models.spherical_pendulum_cartesian().system
    modes = orbits.normal_modes(system, [0.0, 0.0, -1.0])
    assert modes.frequencies == pytest.approx([np.sqrt(9.81)] * 2, rel=1e-13)
    assert modes.signatures == (1, 1)


@pytest.mark.long
def test_a_mode_is_a_motion_that_can_be_shown_and_started(tmp_path):
    held = double_pendulum_held()
    modes = orbits.normal_modes(held, [0.0, -1.0, 0.0, -2.0])
    motion = modes.motion(1, 0.3, frames=20)
    assert motion.duration == pytest.approx(float(modes.periods[1]))
    assert np.abs(motion.value(held.constraint)).max() < 1e-13
    assert np.abs(motion.q[0] - motion.q[-1]).max() < 1e-13
    assert motion.q[:, 2].max() - motion.q[:, 0].min() > 0.3
    modes.animate(0, tmp_path / "mode.gif")
    assert (tmp_path / "mode.gif").stat().st_size > 1000
    assert modes.plot().axes[0].get_title().startswith("$")
    assert "mode 1" in str(modes) and "<th>" in modes._repr_html_()
    with pytest.raises(vi.InputError, match="there are 2 modes"):
        modes.start(2)


@pytest.mark.long
def test_small_orbits_have_the_frequency_of_their_mode():
    system = vi.models.double_pendulum().system
    modes = orbits.normal_modes(system, [0.0, 0.0])
    for k in (0, 1):
        errors = [abs(modes.orbit(k, size).period / modes.periods[k] - 1) for size in (0.02, 0.01)]
        assert 3.9 < errors[0] / errors[1] < 4.1  # the backbone begins as a parabola


def test_equations_without_rest_are_refused():
    rolling = vi.models.rolling_disc().system
    with pytest.raises(vi.InputError):
        orbits.normal_modes(rolling, np.zeros(rolling.structure.n))
    with pytest.raises(vi.InputError, match="give at="):
        orbits.normal_modes(vi.models.pendulum().system)
    q, v = vi.coordinates("x")
    damped = vi.System(q, v, (v**2 - q**2) / 2, force=-0.1 * v)
    with pytest.raises(vi.InputError, match="no undamped oscillation"):
        orbits.normal_modes(damped, [0.0]).orbit(0)
    assert ca.SX(0).is_zero()
