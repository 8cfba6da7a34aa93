"""Every model meets its reference values: in closed form, and simulated by an accurate rule."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pytest
from references import entries

import varint as vi
from varint import models

REFERENCE = entries("a") | entries("b") | entries("c")
ROUND_OFF = 1e-13  # of the state's size: a few hundred roundings
GROWTH = 100  # roundings of 1e-16 on the way, each grown as a change of the start grows
NUDGE = 1e-9  # relative change of start and clock that measures this growth


@dataclass(frozen=True)
class Case:
    """A model with the data of an entry, and how its state (q, v) is written in the entry's
    columns.
    """

    build: Callable[..., models.Model]
    columns: Callable = lambda q, v: np.hstack([q, v])
    key: str = "state"
    width: int | None = None  # of the columns compared; the rest is momenta
    rule: vi.Rule = field(default_factory=lambda: vi.gauss(6))
    h: float | None = None
    until: float = np.inf


def kepler(e):
    return Case(lambda r: models.kepler(e=e))


def sliding(r):
    p, i = r["params"], r["initial"]
    return models.sliding_support(
        X0=i["q"][0],
        theta0=i["q"][1],
        Xdot0=i["v"][0],
        thetadot0=i["v"][1],
        M=p["M"],
        m=p["m"],
        length=p["l"],
        g=p["g"],
    )


def inclined(kind):
    def build(r):
        p, i = r["params"], r["initial"][kind]
        return models.inclined_axis(
            i["theta"], i["thetadot"], p["I"], p["m"], p["d"], p["alpha"], p["g"]
        )

    return Case(build, key=f"{kind}_state")


def caldirola(r):
    p = r["params"]
    return models.caldirola_kanai(r["initial"]["x"], r["initial"]["v"], p["m"], p["w"], p["gamma"])


def forced(r):
    p = r["params"]
    return models.forced_oscillator(
        r["initial"]["x"],
        r["initial"]["v"],
        omega=p["w"],
        force=p["F"],
        Omega=p.get("Omega", p["w"]),
    )


def frame(r):
    return models.rotating_frame(r["initial"]["q"], r["initial"]["v"], r["params"]["Omega"])


def uniform(r):
    p, i = r["params"], r["initial"]
    return models.uniform_fields(p["E"], p["B"], i["q"], i["v"], p["m"], p["q"])


def euler_top(r):
    p = r["params"]
    inertia = p["I"] if "I" in p else [p["I1"], p["I1"], p["I3"]]
    return models.free_rigid_body(inertia, r["initial"]["omega_body"])


def lagrange_top(r):
    p, i = r["params"], r["initial"]
    return models.heavy_top(
        p["I1"],
        p["I3"],
        p["mgl"],
        (i["phi"], i["theta"], i["psi"]),
        (i["phidot"], i["thetadot"], i["psidot"]),
    )


def double_pendulum(r):
    return models.double_pendulum(theta=r["initial"]["q"], g=r["params"]["g"])


def henon(r):
    return models.henon_heiles(r["initial"]["q"], r["initial"]["p"])


def pivot(factory, **names):
    def build(r):
        p, i = r["params"], r["initial"]
        return factory(
            theta0=i["theta"],
            thetadot0=i["thetadot"],
            g=p["g"],
            **{ours: p[theirs] for ours, theirs in names.items()},
        )

    return Case(build)


def rates(q, v):
    """Angular velocity along the body's axes, from (φ, θ, ψ) and their rates."""
    (_, theta, psi), (dphi, dtheta, dpsi) = q.T, v.T
    return np.stack(
        [
            dphi * np.sin(theta) * np.sin(psi) + dtheta * np.cos(psi),
            dphi * np.sin(theta) * np.cos(psi) - dtheta * np.sin(psi),
            dphi * np.cos(theta) + dpsi,
        ],
        -1,
    )


CASES = {
    "A01_central_k_b": Case(lambda r: models.rosette()),
    "A01_isotropic_oscillator": Case(lambda r: models.isotropic_oscillator(omega=r["params"]["w"])),
    "A01_kepler_e02": kepler(0.2),
    "A01_kepler_e06": kepler(0.6),
    "A01_kepler_e09": Case(lambda r: models.kepler(e=0.9), h=0.001, until=20),
    "A02_cart_pendulum_large": Case(sliding, h=0.005),
    "A02_cart_pendulum_moving": Case(sliding),
    "A02_cart_pendulum_rest": Case(sliding),
    "A03_bead_rotating_hoop": Case(lambda r: models.rotating_hoop()),
    "A03_bead_rotating_wire": Case(
        lambda r: models.rotating_wire(), columns=lambda q, v: np.hstack([q, v, 2 * 1.5 * v])
    ),
    "A03_foucault_linear": Case(lambda r: models.foucault_pendulum(), until=3600),
    "A03_rotating_free_2d": Case(frame),
    "A03_rotating_free_3d": Case(frame),
    "A03_rotating_oscillator": Case(
        lambda r: models.turntable((1, 0), (0, 0), Omega=0.3, stiffness=1.0)
    ),
    "A04_inclined_axis_30deg libration": inclined("libration"),
    "A04_inclined_axis_30deg rotation": inclined("rotation"),
    "A04_inclined_axis_horizontal libration": inclined("libration"),
    "A04_inclined_axis_horizontal rotation": inclined("rotation"),
    "A04_pendulum_gnicodes": Case(lambda r: models.pendulum(0.0, 1.0, g=1.0)),
    "A05_spherical_pendulum": Case(
        lambda r: models.spherical_pendulum(),
        lambda q, v: np.stack([q[:, 0], q[:, 1], v[:, 0]], -1),
        "polar",
    ),
    "A06_swinging_atwood_mu3": Case(lambda r: models.swinging_atwood()),
    "A08_field_1_over_r_planar": Case(lambda r: models.inverse_distance_field()),
    "A08_gauge": Case(uniform),
    "A08_uniform_EB_cycloid": Case(uniform),
    "A08_uniform_EB_general": Case(uniform),
    "A09_lagrange_equilateral": Case(lambda r: models.lagrange_triangle()),
    "A09_two_body": Case(lambda r: models.two_body()),
    "A10_accelerated_pivot": pivot(models.accelerated_pivot, acceleration="a"),
    "A10_caldirola_kanai_critical": Case(caldirola, width=2),
    "A10_caldirola_kanai_under": Case(caldirola, width=2),
    "A10_driven_pivot_horizontal": pivot(models.horizontal_pivot, amplitude="a", Omega="Omega"),
    "A10_forced_oscillator": Case(forced),
    "A10_forced_resonance": Case(forced),
    "A10_kapitza_inverted": pivot(models.kapitza_pendulum, amplitude="a", Omega="Omega"),
    "A10_lengthening_pendulum_nonlinear": pivot(models.lengthening_pendulum, length="l0", rate="v"),
    "A10_linear_drag_fall": Case(lambda r: models.linear_drag()),
    "A11_euler_top_axis1": Case(euler_top, rates, "omega"),
    "A11_euler_top_dzhanibekov": Case(euler_top, rates, "omega"),
    "A11_euler_top_generic": Case(euler_top, rates, "omega"),
    "A11_symmetric_free_top": Case(euler_top, rates, "omega"),
    "A11_lagrange_top_loops": Case(
        lagrange_top, lambda q, v: np.stack([q[:, 1], v[:, 1], q[:, 0], q[:, 2]], -1)
    ),
    "A11_lagrange_top_monotone": Case(
        lagrange_top, lambda q, v: np.stack([q[:, 1], v[:, 1], q[:, 0], q[:, 2]], -1)
    ),
    "A12_coupled_oscillators": Case(lambda r: models.coupled_oscillators()),
    "B04_figure_eight": Case(lambda r: models.figure_eight()),
    "C_double_pendulum_chaotic": Case(double_pendulum, h=0.005),
    "C_double_pendulum_regular": Case(double_pendulum),
    "C_fpu_hlw": Case(lambda r: models.fpu_chain(), rule=vi.composition("kahan-li8"), h=0.001),
    "C_henon_heiles_E_1_12": Case(henon),
    "C_henon_heiles_gnicodes": Case(henon),
    "C_henon_heiles_sciml": Case(henon),
    "C_outer_solar_system": Case(
        lambda r: models.outer_solar_system(), rule=vi.composition("kahan-li8"), h=20.0
    ),
}


def data(name):
    """Model, case, times, values, and the change for a change by 1e-16 at the start where the
    entry tells it.
    """
    case, r = CASES[name], REFERENCE[name.split()[0]]
    times, values = np.array(r["times"]), np.array(r["reference"][case.key])[:, : case.width]
    told = [np.array(x)[:, None] for key, x in r["reference"].items() if "change_for_1e-16" in key]
    keep = times <= case.until
    return (
        case.build(r),
        case,
        times[keep],
        values[keep],
        (told[0] if told else np.zeros((len(times), 1)))[keep],
    )


def simulated(model, case, times, nudge=0.0):
    steps, times = int(np.ceil(times[-1] / (case.h or model.h))), times * (1 + nudge)
    start = {"q0": model.q0 * (1 + nudge), "v0": model.v0 * (1 + nudge)}
    motion = vi.simulate(
        model.system,
        case.rule,
        **start,
        duration=times[-1],
        steps=steps,
    ).at(times)
    return case.columns(motion.q, motion.v)[:, : case.width]


def growth(difference):
    """Change of each column, so far, for a relative change of start and clock by 1e-16."""
    return np.maximum.accumulate(np.abs(difference)) * 1e-16 / NUDGE


def bound(values, change):
    """Round-off relative to each column's size, and the roundings on the way as far as the
    motion lets them grow.
    """
    size = np.abs(values).max(axis=0, initial=1e-3)
    return ROUND_OFF * size + GROWTH * change


@pytest.mark.parametrize(
    "name", [n for n, c in CASES.items() if c.build(REFERENCE[n.split()[0]]).exact is not None]
)
def test_the_closed_form_meets_the_reference(name):
    model, case, times, values, _ = data(name)
    found = case.columns(*model.exact(times))[:, : case.width]
    nearby = case.columns(*model.exact(times * (1 + NUDGE)))[:, : case.width]
    error = np.abs(found - values)
    assert (error <= bound(values, growth(nearby - found))).all(), error


@pytest.mark.parametrize("name", CASES)
def test_the_simulation_meets_the_reference(name):
    model, case, times, values, change = data(name)
    found = simulated(model, case, times)
    nearby = simulated(model, case, times, NUDGE)
    change = np.maximum(change, growth(nearby - found))
    error = np.abs(found - values)
    assert (error <= bound(values, change)).all(), error
