"""Chains and oscillators: exchange of energy, solitons, energies asked for."""

from __future__ import annotations

import numpy as np
from model_runs import run
from references import entries

import varint as vi
from varint import models

REFERENCE = entries("c")


def test_stiff_springs_exchange_the_published_energies():
    r = REFERENCE["C_fpu_hlw"]
    model = models.fpu_chain()
    motion = run(model, vi.composition("kahan-li8"), h=0.001, duration=50.0).at(r["times"][:3])
    energies = motion.value(models.fpu_stiff_energies(model))
    assert np.abs(energies - np.array(r["reference"]["I_j"][:3])).max() < 1e-12


def test_a_toda_soliton_keeps_its_shape_and_passes_the_end_of_the_ring():
    model = models.toda_chain(sites=60, kappa=1.0)
    motion = run(model, vi.composition("kahan-li8"), h=0.025, duration=100.0)
    assert motion.t[-1] * np.sinh(1.0) > 60  # sites travelled: once round the ring
    assert np.abs(motion.q - model.exact(motion.t)[0]).max() < 1e-11


def test_henon_heiles_starts_on_the_energy_asked_for():
    for total in (1 / 12, 1 / 8):
        motion = run(models.henon_heiles(total=total), duration=1.0)
        assert abs(motion.energy[0] - total) < 1e-16
