"""The fastest small motion of matrices whose parts are apart from each other."""

from __future__ import annotations

import numpy as np
import pytest

from varint.integration.small_motions import frequency

LABELS = ([0, 0, 1], [0, 1, 0], [0, 1, 2], [1, 0, 1, 0], [0, 1, 1, 1, 2], [0, 1, 2, 0, 1, 2])


@pytest.mark.parametrize("labels", LABELS)
@pytest.mark.parametrize("seed", range(5))
def test_parts_that_are_apart_have_the_frequencies_of_the_whole(labels, seed):
    rng, n, label = np.random.default_rng(seed), len(labels), np.array(labels)
    together = label[:, None] == label
    root, stiffness = rng.normal(size=(2, n, n))
    mass = (root @ root.T + np.eye(n)) * together
    stiffness = (stiffness + stiffness.T) * together
    whole = np.abs(np.linalg.eigvals(np.linalg.solve(mass, stiffness))).max()
    assert frequency(mass, stiffness) == pytest.approx(np.sqrt(whole), rel=1e-13)


def test_a_part_without_inertia_has_no_frequency():
    assert frequency(np.diag([1.0, 0.0, 2.0]), np.eye(3)) is None
    assert np.isnan(frequency(np.eye(3), np.diag([1.0, np.nan, 2.0])))
    assert frequency(np.eye(3), np.diag([0.0, 0.0, 4.0])) == 2.0


@pytest.mark.parametrize("size", [1e160, 1e227, 1e300])
@pytest.mark.parametrize("coupled", [0.0, 1.0])
def test_a_frequency_too_large_for_a_float_is_not_finite_rather_than_an_error(size, coupled):
    stiffness = np.array([[size, coupled], [1.0, 0.0]])
    found = frequency(np.eye(2), stiffness)
    assert np.isinf(found) or found == pytest.approx(np.sqrt(size), rel=1e-13)
