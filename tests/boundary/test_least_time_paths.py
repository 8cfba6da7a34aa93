"""Least time and least length."""

import numpy as np
import pytest
from references import entries, given_and_exact

import varint as vi

REFERENCE = entries("b")


@pytest.mark.parametrize("case", ["unit", "dymos", "halfcycloid", "long"])
def test_the_brachistochrone_is_the_cycloid(case):
    given, exact = given_and_exact("b", f"B03_brachistochrone_{case}")
    model = vi.models.brachistochrone(given["X"], given["Y_drop"], given["g"])
    deep = np.sqrt(2 * given["Y_drop"])
    s = np.linspace(0, 1, 30)[:, None]
    path = vi.least_action(
        model.system,
        vi.gauss(4),
        q_start=[0, 0],
        q_end=[given["X"], deep],
        steps=20,
        guess=np.hstack([given["X"] * s, deep * np.sqrt(s)]),
        duration=vi.free(exact["time_straight_line"], 0.01, 100.0),
    )
    assert path.action == pytest.approx(exact["T"], rel=1e-10)
    assert path.duration == pytest.approx(exact["T"], rel=1e-8)
    x, y, _ = exact["x_y_v_at_T_over_2"]
    assert [path.q[10, 0], path.q[10, 1] ** 2 / 2] == pytest.approx([x, y], rel=1e-7)


@pytest.mark.parametrize("case", ["cops", "symmetric"])
def test_the_catenary_of_given_length_has_its_potential_energy(case):
    given, exact = given_and_exact("b", f"B03_catenary_{case}")
    span, length = given.get("span", 1.0), given["L"]
    path = vi.least_action(
        vi.models.catenary().system,
        vi.gauss(6),
        energy=0.0,
        duration=vi.free(2.0, 0.01, 100.0),
        steps=30,
        q_start=[0.0, given["a"], 0.0],
        q_end=[span, given["b"], length],
    )
    assert path.action == pytest.approx(exact["potential_energy"], rel=1e-12)
    assert path.v[:, 0] == pytest.approx(exact["c"], rel=1e-11)
    assert path.p[:, 2] == pytest.approx(exact["lam"], abs=1e-11)
    assert (
        np.abs(
            path.q[:, 1]
            - exact["lam"]
            - exact["c"] * np.cosh((path.q[:, 0] - exact["t0"]) / exact["c"])
        ).max()
        < 1e-11
    )


def test_geodesics_of_sphere_spheroid_and_torus_have_their_lengths():
    given, exact = given_and_exact("b", "B03_geodesic_sphere")
    sphere = vi.models.great_circle().system
    ends = dict(q_start=[given["theta1"], given["phi1"]], q_end=[given["theta2"], given["phi2"]])
    path = vi.least_action(sphere, vi.gauss(4), duration=1.0, steps=80, **ends)
    assert path.action == pytest.approx(exact["action"], rel=1e-11)
    assert np.abs(path.at([0.25, 0.5, 0.75]).q - exact["theta_phi_points"]).max() < 1e-10

    given, exact = given_and_exact("b", "B03_geodesic_psopt")
    a, b = given["a"], given["b"]
    places = []
    for xyz in (
        REFERENCE["B03_geodesic_psopt"]["initial"][key] for key in ("start_xyz", "end_xyz")
    ):
        places.append([np.arcsin(xyz[2] / b), np.arctan2(xyz[1], xyz[0])])
    path = vi.least_action(
        vi.models.spheroid_geodesic(a=a, b=b).system,
        vi.gauss(6),
        q_start=places[0],
        q_end=places[1],
        duration=1.0,
        steps=20,
    )
    assert np.sqrt(2 * path.action) == pytest.approx(exact["length_km"], rel=1e-12)

    given, exact = given_and_exact("b", "B03_geodesic_torus_circulating")
    torus = vi.models.torus_geodesic().system
    path = vi.least_action(
        torus,
        vi.gauss(6),
        q_start=[0.0, 0.0],
        q_end=exact["state"][1][:2],
        duration=3.0,
        steps=30,
        guess=[[0, 0], exact["state"][0][:2], [1.6, 0.6], exact["state"][1][:2]],
    )
    assert path.action == pytest.approx(1.5, rel=1e-11)  # unit speed
    assert path.v[-1] == pytest.approx(exact["state"][1][2:], rel=1e-9)
