"""What makes no sense of a motion is refused in words; nodes out of order have no sums."""

from __future__ import annotations

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np
import pytest

import varint as vi


def spring() -> vi.Trajectory:
    q, v = vi.coordinates("x", "y")
    system = vi.System(q, v, (ca.sumsqr(v) - ca.sumsqr(q)) / 2)
    return vi.simulate(system, q0=[1, 0], v0=[0, 1], h=0.1, steps=20)


WRONG = [2.5, (1, 2), None, [0.5, 1.0], [0, 99], [True, False], [[1, 2], [3, 4]], slice(0.5, 3)]


@pytest.mark.parametrize("index", WRONG, ids=str)
def test_wrong_indices_are_refused_in_words(index):
    with pytest.raises(vi.InputError, match="number of a node, a slice"):
        spring()[index]


def test_right_indices_are_nodes():
    motion = spring()
    for index in ([1, 3], np.array([1, 3]), np.arange(21) % 2 == 1, slice(1, None, 2), [-1]):
        kept = np.array(index) if isinstance(index, list) else index
        assert np.array_equal(motion[index].q, motion.q[kept])
    assert len(motion[np.array(3)]) == 1 and motion[np.int64(3)].t == motion.t[3]
    with pytest.raises(vi.InputError, match="no node"):
        motion[[]]
    with pytest.raises(IndexError):  # by which loops over it end
        motion[21]


def test_nodes_out_of_order_have_values_and_no_sums():
    motion = spring()
    for part in (motion[::-1], motion[[3, 1, 2]], motion.at([1.0, 0.5])):
        assert part.energy == pytest.approx(np.ones(len(part)), rel=1e-4)
        with pytest.raises(vi.InputError, match="follow each other in time"):
            part.action  # noqa: B018
    again = motion[[1, 1, 2]].action  # from a node to itself nothing is added
    assert again == pytest.approx(motion[1:3].action, rel=1e-14)


def test_figures_files_and_fits_of_nothing_are_refused_in_words():
    motion = spring()
    wrong = {
        "this one is empty": lambda: motion.plot({}),
        "speed must be a number": lambda: motion.animate(speed="fast"),
        "ends in its name": lambda: motion.save(""),
        "data must be": lambda: vi.fit(
            motion.system, data=3, unknown=["q0"], h=0.1, q0=[1, 0], v0=[0, 1]
        ),
        "rising whole numbers": lambda: vi.flow(motion.system, h=0.1, steps=2, nodes=2.5),
        "wrt names what": lambda: vi.sensitivity(motion, None),
    }
    for sentence, call in wrong.items():
        with pytest.raises(vi.InputError, match=sentence):
            call()
    plt.close("all")
    assert vi.flow(motion.system, h=0.1, steps=2, nodes=2).size_out("q") == (2, 1)
