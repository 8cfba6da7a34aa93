"""Several paths between the same ends."""

import numpy as np
import pytest
from references import given_and_exact
from scenes import pendulum

import varint as vi


def test_many_starts_find_all_five_paths_of_the_pendulum():
    given, exact = given_and_exact("b", "B01_pendulum_bvp")
    found = vi.paths(
        pendulum(),
        vi.gauss(4),
        q_start=given["theta0"],
        q_end=given["theta1"],
        duration=given["T"],
        steps=60,
        starts=20,
        spread=3.0,
    )
    wanted = sorted(exact["solutions"], key=lambda solution: solution["action"])
    assert len(found) == len(wanted) == 5
    for path, solution in zip(found, wanted, strict=True):
        assert path.action == pytest.approx(solution["action"], abs=1e-10)
        assert path.v[[0, -1], 0] == pytest.approx([solution["v0"], solution["v_end"]], abs=1e-10)
        assert path.morse_index == solution["morse_index"] == len(path.conjugate_times)
    assert found[0].v[0, 0] == pytest.approx(1.9995687, abs=1e-7)  # the least of all


def test_winding_numbers_lead_once_round_in_both_directions():
    scene = pendulum()
    found = vi.paths(
        scene,
        vi.gauss(4),
        q_start=0.0,
        q_end=1.0,
        duration=10.0,
        steps=60,
        starts=3,
        winding=dict(theta=[-1, 0, 1]),
    )
    assert {round((path.q[-1, 0] - 1) / (2 * np.pi)) for path in found} == {-1, 0, 1}
    assert [path.action for path in found] == sorted(path.action for path in found)
    assert all(np.abs(np.remainder(path.q[-1], 2 * np.pi) - 1).max() < 1e-12 for path in found)
    with pytest.raises(vi.InputError, match="phi"):
        vi.paths(scene, q_start=0, q_end=1, duration=1.0, steps=3, winding=dict(phi=[0]))
