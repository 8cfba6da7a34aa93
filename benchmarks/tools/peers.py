"""The peers of the benchmarks: what each tool can be set to on a varint system, as runs that return
their end.

A `Setting` is one way to run one tool on one scene; `run()` gives q and then v or p at the end
(`momenta` says which), and is all that is timed. `setup` is what it took to get there: building,
compiling.
"""

import tempfile
from collections.abc import Callable, Iterator
from ctypes import CDLL, c_double, c_int64, c_void_p
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import casadi as ca
import heyoka as hy
import numpy as np
from scipy.integrate import solve_ivp
from scipy.integrate._ivp import dop853_coefficients as dop853

from tools import built
from tools.heyoka_peer import taylor
from varint.codegen.mechanics import acceleration, force, velocity
from varint.numerics.arrays import call


@dataclass(frozen=True)
class Setting:
    """One tool with one set of options on one scene."""

    tool: str
    about: str
    run: Callable[[], np.ndarray]
    setup: float = 0.0
    momenta: bool = False


FORMS = "velocities", "momenta"
TOLERANCES = 10.0 ** np.arange(-3, -18.1, -0.75)


def heyoka(
    system, q0, v0, p0, duration, tolerances=TOLERANCES, forms=FORMS, most_steps=0
) -> Iterator[Setting]:
    """Adaptive Taylor integration, compiled by LLVM, in (q, v) and in (q, p).

    The tolerance chooses the order and nothing else: tolerances of the same order are one run. One
    that has taken `most_steps` (0: any number) raises RuntimeError.
    """
    for form, start in zip(FORMS, ([q0, v0], [q0, p0]), strict=True):
        if form not in forms or (form == "momenta" and system.structure.explicit):
            continue
        known: dict[int, Callable[[], np.ndarray]] = {}
        for tol in tolerances:
            began = perf_counter()
            integrator = taylor(system, form, tol)
            setup = perf_counter() - began
            state = np.concatenate(start)

            def run(integrator=integrator, state=state) -> np.ndarray:
                integrator.time = 0.0
                integrator.state[:] = state
                outcome = integrator.propagate_until(duration, max_steps=most_steps)[0]
                if outcome == hy.taylor_outcome.step_limit:
                    raise RuntimeError(f"heyoka has not come to t={duration:g}")
                return integrator.state.copy()

            yield Setting(
                "heyoka",
                f"{form}, tol={tol:.0e}, order {integrator.order}",
                known.setdefault(integrator.order, run),
                setup,
                form == "momenta",
            )


def right_side(system) -> ca.Function:
    """(y, c) → dy/dt in (q, v) where the mass is constant, else in (q, p)."""
    n = system.q.numel()
    if not by_momenta(system):
        y = ca.vertcat(system.q, system.v)
        rate = ca.vertcat(system.v, acceleration(system))
    else:
        p = ca.SX.sym("p", n)
        y, speed = ca.vertcat(system.q, p), velocity(system, p)
        rate = ca.vertcat(speed, ca.substitute(force(system), system.v, speed))
    return ca.Function("rate", [y, system.c], [ca.densify(rate)], {"cse": True})


def by_momenta(system) -> bool:
    """Does `right_side` take q and p?"""
    return not (system.structure.separable and system.structure.constant_mass)


def state_of(system, q0, v0, p0):
    return np.concatenate([q0, p0 if by_momenta(system) else v0])


def scipy_dop853(
    system, q0, v0, p0, duration, tolerances=(1e-5, 1e-8, 1e-11, 1e-13)
) -> Iterator[Setting]:
    """SciPy's DOP853 with the right-hand side as a CasADi function."""
    f, y0, c = right_side(system), state_of(system, q0, v0, p0), system.default_vector
    for tol in tolerances:

        def run(tol=tol):
            found = solve_ivp(
                lambda t, y: call(f, y, c)[0],
                (0, duration),
                y0,
                "DOP853",
                rtol=tol,
                atol=tol,
                t_eval=[duration],
            )
            return found.y[:, -1]

        yield Setting("SciPy DOP853", f"tol={tol:.0e}", run, 0.0, by_momenta(system))


def compiled_dop853(system, q0, v0, p0, duration) -> Iterator[Setting]:
    """The same method in C around the right-hand side that CasADi generates, by the same
    compiler and flags.
    """
    f, y0, c = right_side(system), state_of(system, q0, v0, p0), system.default_vector
    began = perf_counter()
    library = _dop853(f, len(y0))
    setup = perf_counter() - began
    for tol in 10.0 ** np.arange(-3, -15.6, -0.5):

        def run(tol=tol):
            y = y0.copy()
            library.run(y.ctypes.data, c.ctypes.data, duration, tol)
            return y

        yield Setting("compiled DOP853", f"tol={tol:.1e}", run, setup, by_momenta(system))


def _dop853(f: ca.Function, size: int) -> CDLL:
    folder = Path(tempfile.mkdtemp(prefix="dop853"))
    generator = ca.CodeGenerator("rate.c")
    generator.add(f)
    generator.generate(f"{folder}/")
    tables = {
        "A": dop853.A[:12, :12],
        "B": dop853.B[:12],
        "E3": dop853.E3[:12],
        "E5": dop853.E5[:12],
    }
    sizes = {
        "NY": size,
        "ARGS": f.sz_arg(),
        "RESULTS": f.sz_res(),
        "INTEGERS": f.sz_iw(),
        "WORK": f.sz_w(),
    }
    text = "".join(f"#define {name} {value}\n" for name, value in sizes.items())
    text += "".join(
        f"static const double {name}[] = {{{', '.join(float(x).hex() for x in table.ravel())}}};\n"
        for name, table in tables.items()
    )
    library = built.library('#include "rate.c"\n' + text, "dop853.c", folder)
    library.run.argtypes, library.run.restype = [c_void_p, c_void_p, c_double, c_double], c_int64
    return library


def casadi_integrators(
    system, q0, v0, p0, duration, tolerances=(1e-6, 1e-9, 1e-12)
) -> Iterator[Setting]:
    """CasADi's interfaces to CVODES and IDAS."""
    f, y0, c = right_side(system), state_of(system, q0, v0, p0), system.default_vector
    y = ca.SX.sym("y", len(y0))
    problem = {"x": y, "ode": f(y, c)}
    for name in ("cvodes", "idas"):
        for tol in tolerances:
            options = {"reltol": tol, "abstol": tol, "max_num_steps": 10_000_000}
            began = perf_counter()
            integrator = ca.integrator("end", name, problem, 0.0, duration, options)
            setup = perf_counter() - began

            def run(integrator=integrator):
                return np.array(integrator(x0=y0)["xf"])[:, 0]

            yield Setting(f"CasADi {name}", f"tol={tol:.0e}", run, setup, by_momenta(system))


def rebound_bodies(
    masses, G, duration, q0, v0, epsilons=(1e-3, 1e-5, 1e-7, 1e-9, 1e-11)
) -> Iterator[Setting]:
    """REBOUND: IAS15 at several tolerances, WHFast and SABA(10, 6, 4) with several steps, for
    gravitating bodies.
    """
    import rebound

    # one body: massless, around a mass at rest
    bodies = q0.size // 2 if q0.size == 2 else len(masses)
    positions, speeds = q0.reshape(bodies, -1), v0.reshape(bodies, -1)
    if bodies < len(masses):
        positions, speeds = (np.vstack([np.zeros_like(x), x]) for x in (positions, speeds))
    heaviest = int(np.argmax(masses))
    # WHFast wants the star first
    order = [
        heaviest,
        *(i for i in range(len(masses)) if i != heaviest),
    ]

    def simulation():
        sim = rebound.Simulation()
        sim.G = G
        for i in order:
            at = [*positions[i], 0.0][:3]
            moving = [*speeds[i], 0.0][:3]
            sim.add(
                m=masses[i], x=at[0], y=at[1], z=at[2], vx=moving[0], vy=moving[1], vz=moving[2]
            )
        return sim

    def end(sim):
        found, moving = np.empty_like(positions), np.empty_like(positions)
        for place, i in enumerate(order):
            body = sim.particles[place]
            found[i] = [body.x, body.y, body.z][: positions.shape[1]]
            moving[i] = [body.vx, body.vy, body.vz][: positions.shape[1]]
        return np.concatenate([found[-bodies:].ravel(), moving[-bodies:].ravel()])

    def ias15(epsilon):
        sim = simulation()
        sim.integrator = "ias15"
        sim.integrator.epsilon = epsilon
        sim.integrate(duration)
        return end(sim)

    def split(steps, method):
        sim = simulation()
        sim.integrator = method
        sim.integrator.safe_mode = 0
        if method == "whfast":
            sim.integrator.corrector = 17
        else:
            sim.integrator.type = "10_6_4"
        sim.dt = duration / steps
        sim.steps(steps)
        sim.synchronize()
        return end(sim)

    for epsilon in epsilons:
        yield Setting("REBOUND IAS15", f"epsilon={epsilon:.0e}", lambda e=epsilon: ias15(e))
    for steps in (1000, 2000, 4000, 8000, 16_000, 32_000, 64_000):
        yield Setting(
            "REBOUND WHFast", f"{steps} steps, corrector 17", lambda s=steps: split(s, "whfast")
        )
        yield Setting("REBOUND SABA(10,6,4)", f"{steps} steps", lambda s=steps: split(s, "saba"))
