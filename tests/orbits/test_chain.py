"""The equations of an orbit, solved segment by segment, are those solved as one matrix."""

import numpy as np
import pytest

from varint.orbits.chain import Links, condensed


def links(m: int, d: int, border: int, rows: int, growth: float) -> Links:
    """A chain whose segments grow in half of the directions and shrink in the others."""
    rng = np.random.default_rng(m * d + border)
    size = np.diag(np.logspace(np.log10(growth), -np.log10(growth), d))
    turns = np.linalg.qr(rng.normal(size=(2, m, d, d)))[0]
    return Links(
        turns[0] @ size @ turns[1],
        np.broadcast_to(-np.eye(d), (m, d, d)),
        rng.normal(size=(m, d, border)),
        rng.normal(size=(m, d)),
        rng.normal(size=(rows, m, d)),
        rng.normal(size=(rows, border)),
        rng.normal(size=rows),
    )


@pytest.mark.parametrize("m", [1, 2, 3, 20])
@pytest.mark.parametrize("growth", [1.0, 30.0])
def test_the_solution_is_that_of_the_whole_matrix(m, growth):
    chain = links(m, 4, 3, 3, growth)
    found = condensed(chain).least(7)
    left = chain.matrix @ found - chain.whole_right
    assert np.abs(left).max() < 1e-12 * np.abs(chain.matrix).max() * np.abs(found).max()
    wanted = np.linalg.solve(chain.matrix, chain.whole_right)
    assert found == pytest.approx(wanted, rel=1e-9, abs=1e-9 * np.abs(wanted).max())


@pytest.mark.parametrize("m", [1, 2, 9])
def test_the_least_solution_and_the_null_vectors_are_those_of_the_whole_matrix(m):
    chain = links(m, 4, 4, 2, 5.0)  # two unknowns too many
    reduced = condensed(chain)
    null = reduced.null(2)
    assert null @ null.T == pytest.approx(np.eye(2), abs=1e-13)
    assert np.abs(chain.matrix @ null.T).max() < 1e-12
    wanted = np.linalg.lstsq(chain.matrix, chain.whole_right, rcond=None)[0]
    assert reduced.least(6) == pytest.approx(wanted, rel=1e-9, abs=1e-10 * np.abs(wanted).max())


def test_segments_that_grow_and_shrink_by_many_orders_lose_nothing():
    """A product of such maps has lost half of its digits; the chain has not."""
    chain = links(12, 2, 2, 2, 1e3)
    found = condensed(chain).least(4)
    left = chain.matrix @ found - chain.whole_right
    assert np.abs(left).max() < 1e-11 * np.abs(found).max()
    assert np.linalg.norm(np.linalg.multi_dot(list(chain.here))) > 1e15
