"""Periodic orbits against published catalogues, to the digits printed there."""

import numpy as np
import pytest
from references import entries

import varint as vi
from varint import orbits
from varint.orbits.bifurcations import repeated

HALOS = entries("orbits")["halo orbits"]["reference"]
LYAPUNOV = entries("orbits")["Lyapunov orbits of Sun and Jupiter"]
PLANAR = entries("orbits")["Lyapunov orbits of Earth and Moon"]
# of the stability index, relative: what the printed one misses of that of the orbit
PRINTED = {
    "L1, least stability index": 2e-9,
    "L1, largest": 4e-7,
    "L2, least stability index": 3e-6,
    "L2, closest to the Moon": 3e-4,
}
DIGITS = 12  # of the published start that a guess keeps
QUICK = ["halo L1 north, at its birth", "halo L2 south, unstable", "butterfly north, Saturn-Titan"]


@pytest.fixture(scope="module")
def space():
    return vi.models.restricted_three_body().system


def index(found: orbits.Orbit) -> float:
    """(m + 1/m)/2 of the largest absolute value of a multiplier."""
    m = np.abs(found.floquet.multipliers).max()
    return (m + 1 / m) / 2


def refined(space: vi.System, row: dict, **held: float) -> orbits.Orbit:
    x, z, vy = (float(f"{row[name]:.{DIGITS}g}") for name in ("x", "z", "vy"))
    return orbits.periodic(
        space,
        ([x, 0.0, z], [0.0, vy, 0.0]),
        params=dict(mu=row["mu"]),
        period=row["period"],
        **held,
    )


@pytest.mark.parametrize(
    "name", [pytest.param(x, marks=[] if x in QUICK else pytest.mark.long) for x in HALOS]
)
def test_catalogued_orbits_have_their_printed_jacobi_constant_and_stability_index(space, name):
    row = HALOS[name]
    found = refined(space, row)
    hard = "near-rectilinear" in name or "tall" in name  # whose printed vx, vz are 1e-12 to 1e-9
    assert np.abs(found.q0 - [row["x"], 0, row["z"]]).max() < (1e-5 if hard else 1e-6)
    assert found.period == row["period"]
    if "jacobi" in row:
        assert -2 * found.energy == pytest.approx(row["jacobi"], abs=1e-11 if hard else 5e-14)
        near = 2e-5 if "near-rectilinear" in name else 5e-9
        assert index(found) == pytest.approx(row["stability"], rel=near)
    assert np.prod(found.floquet.multipliers).real == pytest.approx(1.0, rel=1e-6)


@pytest.mark.long
@pytest.mark.parametrize("name", [x for x in HALOS if "jacobi" in HALOS[x]])
def test_catalogued_orbits_have_their_printed_period(space, name):
    row = HALOS[name]
    found = refined(space, row, energy=-row["jacobi"] / 2)
    loose = "near-rectilinear" in name or name.startswith(("butterfly", "halo L2 south, "))
    # where C hardly goes with the period, its last digit is worth more of it: δT = δC T'(C)
    assert found.period == pytest.approx(row["period"], abs=1e-9 if loose else 2e-11)
    if "birth" in name or "tall" in name or "small" in name:
        assert found.period == pytest.approx(row["period"], abs=5e-14)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(x, marks=pytest.mark.long if x.endswith(("largest", "Moon", "birth")) else [])
        for x in PLANAR["reference"]
    ],
)
def test_planar_lyapunov_orbits_have_their_printed_numbers(space, name):
    """The period held, and the Jacobi constant; the index to the digits that are right in print,
    and to more of a computation with a longer mantissa.
    """
    row, closest = PLANAR["reference"][name] | PLANAR["params"], name == "L2, closest to the Moon"
    found = refined(space, row | {"z": 0.0})
    assert np.abs(found.q0 - [row["x"], 0, 0]).max() < (5e-8 if closest else 2e-9)
    assert -2 * found.energy == pytest.approx(row["jacobi"], abs=5e-12)
    assert index(found) == pytest.approx(row["stability"], rel=PRINTED.get(name, 1e-10))
    assert index(found) == pytest.approx(row["again"], rel=3e-7 if closest else 5e-9)
    held = refined(space, row | {"z": 0.0}, energy=-row["jacobi"] / 2)
    assert held.period == pytest.approx(row["period"], abs=5e-11 if closest else 5e-12)


@pytest.mark.parametrize("which, guess, way", [("x1", 0.9208, 1), ("x2", 1.0819, -1)])
def test_lyapunov_orbits_lie_where_they_are_proved_to(space, which, guess, way):
    mu, known = LYAPUNOV["params"]["mu"], LYAPUNOV["reference"]
    constant = LYAPUNOV["params"]["jacobi"] - mu * (1 - mu)
    pull = 2 * (1 - mu) / (guess + mu) + 2 * mu / abs(guess - 1 + mu)
    speed = way * np.sqrt(guess**2 + pull - constant)
    found = orbits.periodic(
        space,
        ([guess, 0.0, 0.0], [0.0, speed, 0.0]),
        period=3.1,
        energy=-constant / 2,
        params=dict(mu=mu),
    )
    longer = vi.simulate(
        space,
        found.rule,
        q0=found.q0,
        v0=found.v0,
        h=found.h,
        steps=found.steps + 5,
        params=dict(mu=mu),
    )
    section = orbits.poincare_section(
        longer, space.q[1], direction=way, show=(space.q[0], space.v[0])
    )
    at = section.q[np.abs(section.q[:, 0] - guess).argmin()]
    assert at[0] == pytest.approx(known[which], abs=1e-13)
    if which == "x1":
        assert known["period"][0] - 1e-13 < found.period < known["period"][1] + 1e-13


def test_small_multipliers_come_out_beside_large_ones(space):
    """A halo orbit three times round: multipliers are cubes, 1.3e10 and 7.6e-11 among them."""
    row = HALOS["halo L1 north, at its birth"]
    start = [row["x"], 0.0, row["z"]], [0.0, row["vy"], 0.0]
    once = orbits.periodic(space, start, period=row["period"], params=dict(mu=row["mu"]))
    single, thrice = once.floquet, repeated(once, 3).floquet
    assert np.abs(thrice.multipliers[0]) > 1e10
    for of, near in ((single, 1e-10), (thrice, 1e-9)):
        largest, smallest = of.multipliers[[0, -1]].real
        assert largest * smallest == pytest.approx(1.0, abs=near)
        assert np.abs(np.abs(of.multipliers[1:3]) - 1).max() < near
    assert thrice.multipliers[[0, -1]] == pytest.approx(single.multipliers[[0, -1]] ** 3, rel=1e-9)
    assert np.abs(np.sort(np.angle(thrice.multipliers[1:3]))) == pytest.approx(
        3 * np.abs(np.sort(np.angle(single.multipliers[1:3]))), rel=1e-6
    )
