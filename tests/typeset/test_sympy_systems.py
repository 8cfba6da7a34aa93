"""Scenes from SymPy move as those that were written in CasADi, and as SymPy's own equations say."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

sp = pytest.importorskip("sympy", reason="needs the extra: pip install varint-mechanics[sympy]")

from sympy.physics.mechanics import (  # noqa: E402
    KanesMethod,
    LagrangesMethod,
    Lagrangian,
    Particle,
    Point,
    ReferenceFrame,
    RigidBody,
    dynamicsymbols,
    inertia,
)

import varint as vi  # noqa: E402

T = dynamicsymbols._t
MODELS = [
    "pendulum",
    "sliding_support",
    "spherical_pendulum",
    "double_pendulum",
    "kapitza_pendulum",
    "accelerated_pivot",
    "lengthening_pendulum",
    "caldirola_kanai",
    "rotating_hoop",
    "block_on_wedge",
    "swinging_atwood",
    "henon_heiles",
    "kepler",
    "foucault_pendulum",
    "magnetic_mirror",
    "heavy_top",
    "cart_pole",
    "torus_geodesic",
]


def accelerations(s):
    """(q, v, t, u, c) → L, a by the equations of motion without constraints."""
    rest = s.force + ca.gradient(s.lagrangian, s.q)
    rest -= ca.jtimes(s.momentum, s.q, s.v) + ca.jacobian(s.momentum, s.t)
    a = ca.solve(ca.densify(s.mass_matrix), ca.densify(rest))
    return ca.Function("a", [s.q, s.v, s.t, s.control, s.c], [s.lagrangian, a])


@pytest.mark.parametrize("name", MODELS)
def test_a_scene_comes_back_from_sympy(name):
    """L and the accelerations at random states, to 1e-12."""
    model = vi.models.catalogue[name]()
    s = model.system
    found = vi.equations(s)
    again = vi.from_sympy(
        found.lagrangian.sympy(),
        [dynamicsymbols(x) for x in s.names],
        forces=[x.sympy() for x in found.forces] or None,
        controls=[dynamicsymbols(x) for x in s.control_names],
        parameters=s.defaults,
    )
    assert again.names == s.names and list(again.defaults) == list(s.defaults)
    assert again.control_names == s.control_names
    assert str(again.c) == str(s.c)
    one, other = accelerations(s), accelerations(again)
    rng = np.random.default_rng(5)
    for _ in range(5):
        q, v = model.q0 + rng.uniform(0.05, 0.4, s.structure.n), rng.normal(size=s.structure.n)
        rest = rng.uniform(0, 3), rng.normal(size=s.structure.controls), s.default_vector
        for wanted, got in zip(one(q, v, *rest), other(q, v, *rest), strict=True):
            scale = max(1.0, np.abs(np.array(wanted)).max())
            np.testing.assert_allclose(np.array(got), np.array(wanted), atol=1e-12 * scale)


def test_constraints_come_back_holonomic_and_rolling():
    for name in ("pendulum_cartesian", "turning_wire", "chaplygin_sleigh", "knife_edge"):
        s = vi.models.catalogue[name]().system
        found = vi.equations(s)
        again = vi.from_sympy(
            found.lagrangian.sympy(),
            [dynamicsymbols(x) for x in s.names],
            constraints=[e.left for e in found.constraints],
            parameters=s.defaults,
        )
        count = s.structure.constraints, s.structure.nonholonomic
        assert (again.structure.constraints, again.structure.nonholonomic) == count
        rng = np.random.default_rng(2)
        at = rng.normal(size=s.structure.n), rng.uniform(0, 2), s.default_vector
        one, other = (
            ca.Function("g", [x.q, x.t, x.c], [x.constraint, ca.densify(x.nonholonomic)])
            for x in (s, again)
        )
        for wanted, got in zip(one(*at), other(*at), strict=True):
            np.testing.assert_allclose(np.array(got), np.array(wanted), atol=1e-13)


def by_sympy(method, numbers):
    """Accelerations by SymPy's own mass matrix and forcing."""
    method.form_lagranges_equations()
    n = len(method.q)
    mass = np.array(method.mass_matrix.subs(numbers).evalf()).astype(float)[:, :n]
    forcing = np.array(method.forcing.subs(numbers).evalf()).astype(float).ravel()
    return np.linalg.solve(mass, forcing)


def two_links():
    """A cart with a pendulum that is a rigid body, pushed, dragged and turned by a motor."""
    x, theta, push = dynamicsymbols("x theta push")
    M, m, ell, inertia_, g, d = sp.symbols("M m ell I g d")
    N = ReferenceFrame("N")
    A = N.orientnew("A", "Axis", [theta, N.z])
    origin, cart, bob = Point("O"), Point("C"), Point("B")
    origin.set_vel(N, 0)
    cart.set_pos(origin, x * N.x)
    cart.set_vel(N, x.diff(T) * N.x)
    bob.set_pos(cart, -ell * A.y)
    bob.v2pt_theory(cart, N, A)
    trolley = Particle("trolley", cart, M)
    body = RigidBody("body", bob, A, m, (inertia(A, 0, 0, inertia_), bob))
    body.potential_energy = -m * g * ell * sp.cos(theta)
    loads = [(cart, push * N.x), (bob, -d * bob.vel(N)), (A, -d * theta.diff(T) * N.z)]
    method = LagrangesMethod(
        Lagrangian(N, trolley, body), [x, theta], forcelist=loads, frame=N, bodies=[trolley, body]
    )
    return method, push, {M: 2.0, m: 0.7, ell: 0.9, inertia_: 0.3, g: 9.81, d: 0.4}


def test_an_object_of_lagranges_method_moves_as_sympy_says():
    method, push, values = two_links()
    s = vi.from_sympy(method, parameters=values, controls=[push])
    assert s.names == ("x", "theta") and s.control_names == ("push",)
    rng = np.random.default_rng(3)
    for _ in range(3):
        q, v, u = rng.normal(size=2), rng.normal(size=2), rng.normal(size=1)
        state = dict(zip([x.diff(T) for x in method.q], v, strict=True))
        state |= dict(zip(method.q, q, strict=True)) | {push: u[0]} | values
        _, a = accelerations(s)(q, v, 0, u, s.default_vector)
        np.testing.assert_allclose(np.array(a).ravel(), by_sympy(method, state), rtol=1e-11)


def test_lagranges_method_with_constraints_gives_the_pendulum():
    x, y = dynamicsymbols("x y")
    m, ell, g = sp.symbols("m ell g")
    L = m * (x.diff(T) ** 2 + y.diff(T) ** 2) / 2 - m * g * y
    method = LagrangesMethod(L, [x, y], hol_coneqs=[x**2 + y**2 - ell**2])
    s = vi.from_sympy(method, parameters={m: 1, ell: 1, "g": 9.81})
    model = vi.models.pendulum_cartesian()
    motion = vi.simulate(s, vi.lobatto(3), q0=model.q0, v0=model.v0, h=0.01, steps=50)
    wanted = vi.simulate(model.system, vi.lobatto(3), q0=model.q0, v0=model.v0, h=0.01, steps=50)
    np.testing.assert_allclose(motion.q, wanted.q, atol=1e-12)
    rolling = LagrangesMethod(L, [x, y], nonhol_coneqs=[x.diff(T) * sp.cos(y) - y.diff(T)])
    assert vi.from_sympy(rolling, parameters={m: 1, g: 1}).structure.nonholonomic == 1


def test_an_object_of_kanes_method_moves_as_its_own_equations_say():
    """A rigid body turned by 3-1-3 angles, its speeds the body's components of ω, with a bob that
    slides along it, a load that is no potential, and a time-dependent torque.
    """
    q, u = dynamicsymbols("phi theta psi x"), dynamicsymbols("w1 w2 w3 s")
    m, g, d = sp.symbols("m g d")
    N, A = ReferenceFrame("N"), ReferenceFrame("A")
    A.orient(N, "body", q[:3], "313")
    A.set_ang_vel(N, u[0] * A.x + u[1] * A.y + u[2] * A.z)
    origin, bob = Point("O"), Point("B")
    origin.set_vel(N, 0)
    bob.set_pos(origin, q[3] * A.x)
    bob.set_vel(A, u[3] * A.x)
    bob.v1pt_theory(origin, N, A)
    R = ReferenceFrame("R")
    R.orient(N, "body", q[:3], "313")
    turning = R.ang_vel_in(N)
    kinematics = [u[k] - turning.dot(e) for k, e in enumerate((R.x, R.y, R.z))] + [
        u[3] - q[3].diff(T)
    ]
    body = RigidBody("body", origin, A, 1.5, (inertia(A, 0.4, 0.7, 0.9), origin))
    bead = Particle("bead", bob, m)
    loads = [(bob, -d * bob.vel(N)), (A, sp.cos(T) * N.x), (bob, -m * g * N.z)]
    method = KanesMethod(N, q, u, kinematics, bodies=[body, bead], forcelist=loads)
    values = {m: 0.6, g: 9.81, d: 0.3}
    s = vi.from_sympy(method, parameters=values)
    method.kanes_equations()
    rng = np.random.default_rng(5)
    for _ in range(2):
        x, v = rng.uniform(0.5, 1.0, 4), rng.normal(size=4)
        _, a = accelerations(s)(x, v, 0.3, [], s.default_vector)
        rates = dict(zip([y.diff(T) for y in q], v, strict=True))
        seconds = dict(zip([y.diff(T, 2) for y in q], np.array(a).ravel(), strict=True))
        state = dict(zip(q, x, strict=True)) | values | {T: 0.3}
        known = {w: w - e for w, e in zip(u, kinematics, strict=True)}  # u of q and its rates
        speeds = {w: e.xreplace(rates | state) for w, e in known.items()}
        changes = sp.Matrix([e.diff(T).xreplace(seconds | rates | state) for e in known.values()])
        mass = method.mass_matrix.xreplace(speeds | state)
        forcing = method.forcing.xreplace(speeds | state)
        np.testing.assert_allclose(
            np.array(mass * changes, float), np.array(forcing, float), atol=1e-12
        )


def test_of_kanes_method_only_constraints_that_say_something_new_are_kept():
    x, y, angle, v1, v2, w = dynamicsymbols("x y angle v1 v2 w")
    N = ReferenceFrame("N")
    A = N.orientnew("A", "Axis", [angle, N.z])
    origin, blade = Point("O"), Point("P")
    origin.set_vel(N, 0)
    blade.set_pos(origin, x * N.x + y * N.y)
    blade.set_vel(N, v1 * N.x + v2 * N.y)
    A.set_ang_vel(N, w * N.z)
    body = RigidBody("skate", blade, A, 2, (inertia(A, 0, 0, 0.5), blade))
    rates = [v1 - x.diff(T), v2 - y.diff(T), w - angle.diff(T)]
    rows = [blade.vel(N).dot(A.y)]
    skate = KanesMethod(
        N, [x, y, angle], [v1, w], rates, u_dependent=[v2], velocity_constraints=rows, bodies=[body]
    )
    s = vi.from_sympy(skate)
    assert (s.structure.constraints, s.structure.nonholonomic) == (0, 1)
    bound = KanesMethod(
        N,
        [x, angle],
        [v1, w],
        rates,
        q_dependent=[y],
        u_dependent=[v2],
        bodies=[body],
        configuration_constraints=[x**2 + y**2 - 1],
        velocity_constraints=[x * v1 + y * v2],
    )
    s = vi.from_sympy(bound)
    assert (s.structure.constraints, s.structure.nonholonomic) == (1, 0)


def test_rolling_that_is_built_into_velocities_is_refused():
    """SymPy's own rolling disc: its T is not that of a free disc, and has no Lagrange equations."""
    q, u = dynamicsymbols("q1:4"), dynamicsymbols("u1:4")
    N = ReferenceFrame("N")
    Y = N.orientnew("Y", "Axis", [q[0], N.z])
    L = Y.orientnew("L", "Axis", [q[1], Y.x])
    R = L.orientnew("R", "Axis", [q[2], L.y])
    turning = R.ang_vel_in(N)
    rates = [turning.dot(e) - x for e, x in zip((L.x, L.y, L.z), u, strict=True)]
    R.set_ang_vel(N, u[0] * L.x + u[1] * L.y + u[2] * L.z)
    contact = Point("C")
    contact.set_vel(N, 0)
    centre = contact.locatenew("centre", L.z)
    centre.v2pt_theory(contact, N, R)
    disc = RigidBody("disc", centre, R, 1, (inertia(L, 0.25, 0.5, 0.25), centre))
    method = KanesMethod(N, q, u, rates, bodies=[disc], forcelist=[(centre, -9.81 * Y.z)])
    with pytest.raises(vi.InputError, match="disc is no derivative of a position"):
        vi.from_sympy(method)


X = dynamicsymbols("x")
K = sp.Symbol("k")
FREE = X.diff(T) ** 2 / 2


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: vi.from_sympy(FREE + sp.gamma(X) + sp.zeta(X), [X]), r"\['gamma', 'zeta'\]"),
        (lambda: vi.from_sympy(FREE + X.diff(T, 2), [X]), "only coordinates and their first"),
        (lambda: vi.from_sympy(FREE - K * X**2, [X]), r"\['k'\], which nobody declared"),
        (lambda: vi.from_sympy(FREE - dynamicsymbols("w"), [X]), r"\['w\(t\)'\]"),
        (lambda: vi.from_sympy(FREE, []), "coordinates must list functions of time"),
        (lambda: vi.from_sympy(FREE, [K]), "a coordinate is a function of time"),
        (lambda: vi.from_sympy(FREE, "x"), "must be a list"),
        (lambda: vi.from_sympy(FREE, [X], forces=[0, 0]), "2 forces for 1 coordinates"),
        (lambda: vi.from_sympy(FREE, [X], constraints=[X.diff(T) ** 2]), "linear in them"),
        (lambda: vi.from_sympy(FREE, [X], constraints=[X.diff(T) - 1]), "linear in them"),
        (lambda: vi.from_sympy(FREE, [X], parameters=[K]), "must be a dictionary"),
        (lambda: vi.from_sympy(FREE, [X], parameters={K: 1, "k": 2}), "two values for 'k'"),
        (lambda: vi.from_sympy(FREE, [X], parameters={1: 1}), "keys are symbols or names"),
        (lambda: vi.from_sympy("x", [X]), "must be a SymPy expression"),
        (lambda: vi.from_sympy(sp.Matrix([FREE]), [X]), "scalar SymPy expression"),
        (lambda: vi.from_sympy(ca.SX.sym("x"), [X]), "hand it to System"),
        (lambda: vi.from_sympy(LagrangesMethod(FREE, [X]), [X]), "of its own"),
    ],
)
def test_what_cannot_be_a_scene_is_refused_in_words(call, words):
    with pytest.raises(vi.InputError, match=words):
        call()


def test_names_time_and_conditions_stay():
    omega = sp.Symbol("Omega")
    L = FREE - sp.Piecewise((X**2, X > 0), (2 * X**2, True)) * sp.cos(omega * T)
    s = vi.from_sympy(L, [X], parameters={omega: 3.0})
    assert s.names == ("x",) and not s.structure.autonomous and s.defaults["Omega"] == 3.0
    function = ca.Function("L", [s.q, s.v, s.t, s.c], [s.lagrangian])
    for x in (-0.5, 0.5):
        wanted = 2.0 - (x**2 if x > 0 else 2 * x**2) * np.cos(1.5)
        assert float(function(x, 2.0, 0.5, 3.0)) == pytest.approx(wanted, rel=1e-14)
