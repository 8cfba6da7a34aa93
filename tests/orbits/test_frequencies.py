"""Frequencies: sums of lines to round-off, the pendulum by elliptic integrals, drift and
resonances.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.models import pendulum_period

NU = np.array([1.0, -0.37, 2.2345, 0.998, 0.1])
A = np.array([1.0, 0.5, 1e-3, 1e-5, 0.02]) * np.exp(1j * np.array([0.3, 1.0, 4.0, 2.0, 5.0]))
T = np.arange(4096) * 0.25 - 100.0


@pytest.mark.parametrize("window", [1, 3, 6])
def test_a_sum_of_lines_is_found_to_round_off(window):
    """Two of them one bin of a transform apart, one 1e-5 of the largest."""
    found = vi.orbits.naff(T, np.exp(1j * np.outer(T, NU)) @ A, 5, window=window)
    order = np.argsort(-np.abs(A))
    assert np.allclose(found.frequencies, NU[order], atol=1e-10)
    assert np.allclose(found.amplitudes, np.abs(A)[order], rtol=1e-8)
    assert np.allclose(np.exp(1j * found.phases), np.exp(1j * np.angle(A[order])), atol=1e-7)
    assert np.allclose(found.at(T), np.exp(1j * np.outer(T, NU)) @ A, atol=1e-12)


def test_a_real_signal_has_positive_frequencies_and_its_mean():
    z = 3.0 + 2 * np.cos(1.7 * T + 0.4) - 0.1 * np.sin(0.61 * T)
    found = vi.orbits.naff(T, z, 3)
    assert np.allclose(found.frequencies, [0.0, 1.7, 0.61], atol=1e-12)
    assert np.allclose(found.amplitudes, [3, 2, 0.1], rtol=1e-11)
    assert found.phases[1] == pytest.approx(0.4, abs=1e-10) and found.real
    assert np.abs(found.at(T) - z).max() < 1e-12


def test_fewer_lines_are_returned_where_nothing_is_left():
    assert len(vi.orbits.naff(T, np.exp(0.7j * T), 6).frequencies) < 4
    assert len(vi.orbits.naff(T, np.zeros(len(T)), 3).frequencies) == 0


def test_before_the_correction_together_windows_are_of_their_order():
    """One line found while another disturbs it: the error falls with T like T^−(2p + 2)."""
    errors = {}
    for window in (1, 2):
        for count in (256, 512, 1024):
            t = np.arange(count) * 0.5
            z = np.exp(1j * t) + 0.3 * np.exp(1.53j * t)
            found = vi.orbits.naff(t, z, 1, window=window)
            errors[window, count] = abs(found.frequencies[0] - 1)
    for window in (1, 2):
        fall = np.log2(errors[window, 256] / errors[window, 1024]) / 2
        assert fall > 2 * window + 1, (window, fall)


def test_the_pendulum_turns_with_the_frequency_of_its_elliptic_integral():
    """θ0 = 2: odd multiples of 2π/T alone."""
    model = vi.models.pendulum(theta0=2.0)
    motion = vi.simulate(model.system, vi.gauss(8), q0=model.q0, v0=model.v0, h=0.05, steps=6000)
    found = vi.orbits.frequencies(motion, model.system.q, 4)
    unit = 2 * np.pi / pendulum_period(2.0, np.sqrt(9.81))
    assert np.allclose(found.frequencies / unit, [1, 3, 5, 7], atol=1e-10)
    pair = vi.orbits.frequencies(motion, (model.system.q, -model.system.momentum), 1)
    assert pair.frequencies[0] == pytest.approx(unit, abs=1e-10)  # against the clock otherwise


def test_a_frequency_map_tells_tori_from_chaos():
    system = vi.models.henon_heiles().system
    starts = vi.orbits.starts_at_energy(
        system, 1 / 8, q0=[[0, 0.25], [0, -0.15]], v0=[0, 0], free=system.v[0]
    )
    runs = vi.ensemble(system, vi.gauss(6), **starts, h=0.25, steps=4000)
    found = vi.orbits.frequency_map(runs, [system.q[0], system.q[1]])
    assert found.diffusion[0] < -7 and found.diffusion[1] > -4
    found.plot()


@pytest.mark.parametrize(
    ("nu", "k", "name"),
    [
        ([1.0, 2.0], (2, -1), "ν₁ : ν₂ = 1 : 2"),
        ([3.0, 2.0], (2, -3), "ν₁ : ν₂ = 3 : 2"),
        ([1.0, 2**0.5, 1 + 2**0.5], (1, 1, -1), "ν₁ + ν₂ − ν₃ = 0"),
    ],
)
def test_resonances_are_named(nu, k, name):
    assert vi.orbits.resonance(nu) == k and vi.orbits.resonance_name(k) == name


def test_frequencies_far_from_whole_ratios_are_no_resonance():
    assert vi.orbits.resonance([1.0, (1 + 5**0.5) / 2]) is None


def test_bad_input_is_refused_in_words():
    q, v = vi.coordinates("x")
    motion = vi.simulate(
        vi.System(q, v, v**2 / 2 - q**2 / 2), vi.gauss(2), q0=1, v0=0, h=0.1, steps=50
    )
    for work, words in (
        (lambda: vi.orbits.naff(T[:8], T[:8]), "at least 16"),
        (lambda: vi.orbits.naff(T**2, T), "equal distances"),
        (lambda: vi.orbits.naff(T, T * np.nan), "finite"),
        (lambda: vi.orbits.naff(T, T, 0), "count"),
        (lambda: vi.orbits.naff(T, T, 1, window=9), "window"),
        (lambda: vi.orbits.frequencies(3, q), "motion"),
        (lambda: vi.orbits.frequencies(motion, ca.vertcat(q, v)), "one SX expression"),
        (lambda: vi.orbits.frequency_map(motion, [q]), "many motions"),
        (lambda: vi.orbits.frequency_map([motion], q), "list of expressions"),
    ):
        with pytest.raises(vi.InputError, match=words):
            work()
