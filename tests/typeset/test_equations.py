"""The equations to read are those that the scene moves by, and come out as in the book."""

from __future__ import annotations

import re
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

sp = pytest.importorskip("sympy", reason="needs the extra: pip install varint-mechanics[sympy]")

import varint as vi  # noqa: E402
from varint.typeset.formula import Conserved  # noqa: E402

T = sp.Symbol("t")
MODELS = [
    "pendulum",
    "sliding_support",
    "spherical_pendulum",
    "double_pendulum",
    "kapitza_pendulum",
    "linear_drag",
    "caldirola_kanai",
    "block_on_wedge",
    "swinging_atwood",
    "henon_heiles",
    "kepler",
    "central_force",
    "foucault_pendulum",
    "magnetic_mirror",
    "heavy_top",
    "cart_pole",
    "brachistochrone",
    "lotka_volterra",
    "pendulum_cartesian",
    "atwood",
    "turning_wire",
    "falling_ladder",
    "chaplygin_sleigh",
]
KNOWN: dict[str, tuple] = {}


def derived(name):
    """The model and its equations, derived once."""
    if name not in KNOWN:
        model = vi.models.catalogue[name]()
        KNOWN[name] = model, vi.equations(model.system)
    return KNOWN[name]


def functions_of(system):
    return [sp.Function(name)(T) for name in system.names]


def numbers(system, q, v, a, t, u, multipliers=(), momenta=()):
    """What stands for each symbol of the equations at one state."""
    path = functions_of(system)
    table = dict(zip((x.diff(T, 2) for x in path), a, strict=False))
    table |= dict(zip((x.diff(T) for x in path), v, strict=True))
    table |= dict(zip(path, q, strict=True))
    table |= {sp.Function(name)(T): x for name, x in zip(system.control_names, u, strict=True)}
    names = [x.name() for x in ca.vertsplit(system.c)] if system.c.numel() else []
    table |= {sp.Symbol(x): y for x, y in zip(names, system.default_vector, strict=True)}
    table |= {sp.Function(f"lambda_{i + 1}")(T): x for i, x in enumerate(multipliers)}
    table |= {sp.Function(f"p_{x}")(T): y for x, y in zip(system.names, momenta, strict=False)}
    return table | {T: t}


def value(e, table):
    """A number by NumPy's functions."""
    letters = {x: sp.Dummy() for x in table}
    f = sp.lambdify(list(letters.values()), e.xreplace(letters), "numpy")
    return float(f(*table.values()))


def state(model, seed):
    """A random state near the model's start, and random accelerations, controls, multipliers."""
    rng, s = np.random.default_rng(seed), model.system
    n = s.structure.n
    count = s.structure.constraints + s.structure.nonholonomic + s.structure.contacts
    near = model.q0 + rng.uniform(0.05, 0.3, n)
    return (
        near,
        rng.normal(size=n),
        rng.normal(size=n),
        rng.uniform(0.1, 2),
        rng.normal(size=s.structure.controls),
        rng.normal(size=count),
    )


def euler_function(s):
    """(q, v, a, t, u, λ) → d/dt ∂L/∂v − ∂L/∂q, Wᵀλ + F, both by CasADi; p, E."""
    a = ca.SX.sym("a", s.q.numel())
    rows = ca.vertcat(ca.jacobian(s.constraint, s.q), s.nonholonomic, ca.jacobian(s.contact, s.q))
    lam = ca.SX.sym("lam", rows.shape[0])
    left = ca.jtimes(s.momentum, s.q, s.v) + ca.jtimes(s.momentum, s.v, a)
    left += ca.jacobian(s.momentum, s.t) - ca.gradient(s.lagrangian, s.q)
    outputs = [left, rows.T @ lam + s.force, s.momentum, s.energy, s.lagrangian]
    return ca.Function("e", [s.q, s.v, a, s.t, s.control, lam, s.c], outputs)


@pytest.mark.parametrize("name", MODELS)
def test_what_is_written_has_the_values_of_the_scene(name):
    """Left minus right is a constant multiple of the scene's own; L, p, E and H agree."""
    model, found = derived(name)
    s = model.system
    function = euler_function(s)
    ratios = []
    for seed in range(3):
        q, v, a, t, u, lam = state(model, seed)
        left, right, p, energy, lagrangian = (
            np.array(x).ravel() for x in function(q, v, a, t, u, lam, s.default_vector)
        )
        table = numbers(s, q, v, a, t, u, lam, p)
        wrote = [(value(e.left, table), value(e.right, table)) for e in found.euler_lagrange]
        ratios.append([(x - y) / e for (x, y), e in zip(wrote, left - right, strict=True)])
        tight = dict(rtol=1e-12, atol=1e-12 * max(1, abs(lagrangian[0])))
        np.testing.assert_allclose([value(x.expression, table) for x in found.momenta], p, **tight)
        assert value(found.energy.expression, table) == pytest.approx(energy[0], rel=1e-11)
        assert value(found.lagrangian.sympy(), table) == pytest.approx(lagrangian[0], rel=1e-11)
        if found.hamiltonian is not None:
            assert value(found.hamiltonian.sympy(), table) == pytest.approx(energy[0], rel=1e-10)
    np.testing.assert_allclose(ratios[1:], [ratios[0]] * 2, rtol=1e-9)
    assert all(x > 0 for x in ratios[0])


@pytest.mark.parametrize(
    "name", ["sliding_support", "spherical_pendulum", "central_force", "heavy_top"]
)
def test_the_effective_potential_is_the_energy_where_what_is_left_rests(name):
    model, found = derived(name)
    s = model.system
    free = [s.names.index(x.name) for x in found.cyclic if not x.broken_by]
    rng = np.random.default_rng(0)
    v = np.zeros(s.structure.n)
    v[free] = rng.normal(size=len(free))
    q = model.q0 + rng.uniform(0.1, 0.3, s.structure.n)
    function = ca.Function("f", [s.q, s.v, s.t, s.c], [s.momentum, s.energy])
    p, energy = function(q, v, 0, s.default_vector)
    table = numbers(s, q, v, v, 0.0, [])
    table |= {sp.Symbol(f"p_{s.names[i]}"): float(p[i]) for i in free}
    assert free and found.effective_potential is not None
    potential = found.effective_potential.sympy()
    assert value(potential, table) == pytest.approx(float(energy), rel=1e-12)
    assert not potential.atoms(sp.Derivative)


@pytest.mark.parametrize("name", ["sliding_support", "kepler", "heavy_top", "block_on_wedge"])
def test_what_is_called_conserved_is_conserved_along_the_motion(name):
    model, found = derived(name)
    motion = vi.simulate(model.system, q0=model.q0, v0=model.v0, duration=1.0, tol=1e-11)
    kept = [x for x in found.conserved if not x.broken_by]
    assert len(kept) >= 2
    for x in kept:
        values = []
        for node in (0, len(motion) // 2, len(motion) - 1):
            at = motion[node]
            values.append(value(x.sympy(), numbers(model.system, at.q, at.v, at.v, at.t, [])))
        assert np.ptp(values) <= 1e-8 * max(1.0, np.abs(values).max()), x


def book(name):
    """Functions of time by name, and symbols."""
    return sp.Function(name)(T)


def same(e, other):
    return sp.simplify(e - other) == 0


def test_the_pendulum_is_that_of_the_book():
    c = vi.Parameters(m=1.0, ell=1.0, g=9.81)
    q, v = vi.coordinates("theta")
    L = c.m * c.ell**2 * v**2 / 2 + c.m * c.g * c.ell * ca.cos(q)
    found = vi.equations(vi.System(q, v, L, params=c))
    m, ell, g, theta = *sp.symbols("m ell g"), book("theta")
    assert found.euler_lagrange[0].sympy() == sp.Eq(
        theta.diff(T, 2) + g / ell * sp.sin(theta), 0, evaluate=False
    )
    assert str(found.euler_lagrange[0]) == "θ̈ + (g/ℓ) sin(θ) = 0"
    assert found.euler_lagrange[0].latex() == r"\ddot{\theta} + \frac{g}{\ell} \sin \theta = 0"
    assert str(found.hamiltonian) == "H = p_θ²/(2 m ℓ²) - m ℓ g cos(θ)"
    assert str(found.momenta[0]) == "p_θ = m ℓ² θ̇" and found.momenta[0].sympy() == (
        m * ell**2 * theta.diff(T)
    )
    assert not found.cyclic and not found.constraints and found.effective_potential is None


def test_a_scene_has_its_equations_and_all_of_them_go_to_sympy_under_their_headings():
    scene = vi.models.pendulum().system
    assert scene.equations is vi.equations(scene)
    derived = scene.equations.sympy()
    assert list(derived) == [heading for heading, _ in scene.equations.sections]
    assert derived["Euler–Lagrange equations"] == [scene.equations.euler_lagrange[0].sympy()]


def test_the_double_pendulum_is_that_of_the_book():
    """Landau & Lifshitz, Mechanics, §5, problem 1."""
    _, found = derived("double_pendulum")
    (m1, m2), (l1, l2), g = sp.symbols("m_0 m_1"), sp.symbols("length_0 length_1"), sp.Symbol("g")
    a, b = book("theta1"), book("theta2")
    L = (m1 + m2) * l1**2 * a.diff(T) ** 2 / 2 + m2 * l2**2 * b.diff(T) ** 2 / 2
    L += m2 * l1 * l2 * a.diff(T) * b.diff(T) * sp.cos(a - b)
    L += (m1 + m2) * g * l1 * sp.cos(a) + m2 * g * l2 * sp.cos(b)
    assert found.lagrangian.sympy() == L
    assert str(found.lagrangian) == (
        "L = ½ (m₀ + m₁) length₀² θ̇₁² + m₁ length₀ length₁ θ̇₁ θ̇₂ cos(θ₁ - θ₂)"
        " + ½ m₁ length₁² θ̇₂² + (m₀ + m₁) length₀ g cos(θ₁) + m₁ length₁ g cos(θ₂)"
    )
    second = l1 * a.diff(T, 2) * sp.cos(a - b) + l2 * b.diff(T, 2)
    second += g * sp.sin(b) - l1 * a.diff(T) ** 2 * sp.sin(a - b)
    assert found.euler_lagrange[1].left == second


def test_the_support_slides_with_a_conserved_momentum():
    """Landau & Lifshitz, Mechanics, §5, problem 2: Ẍ cos θ + ℓ θ̈ = −g sin θ."""
    _, found = derived("sliding_support")
    M, m, ell, g = sp.symbols("M m length g")
    X, theta = book("X"), book("theta")
    [cyclic] = found.cyclic
    assert cyclic.name == "X" and not cyclic.broken_by
    assert cyclic.sympy() == (m + M) * X.diff(T) + m * ell * theta.diff(T) * sp.cos(theta)
    assert "X: p_X = (M + m) Ẋ + m length θ̇ cos(θ), conserved" in str(found)
    right = X.diff(T, 2) * sp.cos(theta) + ell * theta.diff(T, 2) + g * sp.sin(theta)
    assert found.euler_lagrange[1].left == right
    h = found.hamiltonian.sympy()
    p, P = book("p_theta"), book("p_X")
    kinetic = (M + m) * p**2 / m / ell**2 + P**2 - 2 * P * p * sp.cos(theta) / ell
    kinetic /= 2 * (M + m * sp.sin(theta) ** 2)
    assert same(h, kinetic - m * g * ell * sp.cos(theta))


def test_the_spherical_pendulum_and_kepler_have_the_potentials_of_the_book():
    m, ell, g, p = sp.symbols("m length g p_phi")
    _, spherical = derived("spherical_pendulum")
    theta = book("theta")
    wanted = p**2 / (2 * m * ell**2 * sp.sin(theta) ** 2) - m * g * ell * sp.cos(theta)
    assert spherical.effective_potential.sympy() == wanted
    assert [x.name for x in spherical.cyclic] == ["phi"]
    _, kepler = derived("central_force")
    assert str(kepler.effective_potential) == "V_eff = p_θ²/(2 m r²) - k/r"
    assert str(kepler.euler_lagrange[0]) == "r̈ - r θ̇² + k/(m r²) = 0"
    assert "Effective potential without θ" in str(kepler)


def test_a_cyclic_coordinate_is_found_where_only_algebra_shows_it():
    q, v = vi.coordinates("r", "phi")
    place = q[0] * ca.vertcat(ca.cos(q[1]), ca.sin(q[1]))
    speed = ca.jtimes(place, q, v)
    system = vi.System(q, v, ca.sumsqr(speed) / 2 - ca.sumsqr(place))
    assert system.structure.cyclic == ()
    assert [x.name for x in vi.equations(system).cyclic] == ["phi"]
    assert str(vi.equations(system).lagrangian) == "L = ½ ṙ² + ½ r² φ̇² - r²"


def test_what_acts_along_a_cyclic_coordinate_breaks_its_conservation():
    _, ladder = derived("falling_ladder")
    assert {x.name: x.broken_by for x in ladder.cyclic} == {
        "x": ("contact",),
        "theta": ("contact",),
    }
    assert "Symmetries of L alone" in str(ladder) and "Effective" not in str(ladder)
    assert str(ladder.euler_lagrange[2]) == (
        "inertia θ̈ = ½ length λ₁ sin(θ) - ½ length λ₂ cos(θ) + λ₃"
    )
    assert [x.relation for x in ladder.constraints] == ["GreaterThan"] * 3
    assert isinstance(ladder.constraints[0].sympy(), sp.Ge)
    _, cart = derived("cart_pole")
    assert cart.cyclic[0].broken_by == ("force",) and len(cart.forces) == 2
    _, sleigh = derived("chaplygin_sleigh")
    assert all("nonholonomic" in x.broken_by for x in sleigh.cyclic if x.name in "xy")


def test_reactions_stand_on_the_right_with_their_multipliers():
    _, found = derived("pendulum_cartesian")
    assert [str(e) for e in found.euler_lagrange] == [
        "mass ẍ = 2 λ₁ x",
        "mass ÿ + mass gravity = 2 λ₁ y",
    ]
    assert str(found.constraints[0]) == "x² + y² - length² = 0"


def test_names_that_the_scene_has_are_not_taken_twice():
    c = vi.Parameters(p_x=2.0, lambda_1=3.0)
    q, v = vi.coordinates("x", "y")
    L = ca.sumsqr(v) / 2 - c.p_x * q[1] * c.lambda_1
    found = vi.equations(vi.System(q, v, L, constraint=q[0] - q[1], params=c))
    assert [x.name for x in found.momenta] == ["p_x_new", "p_y_new"]
    assert "lambda_1_new" in str(found.euler_lagrange[0].right)
    with pytest.raises(vi.InputError, match="'t' is the name of time"):
        q, v = vi.coordinates("t")
        vi.equations(vi.System(q, v, v**2 - q, t=ca.SX.sym("tau")))


def test_the_inverse_of_a_large_mass_matrix_stands_in_the_hamiltonian_by_letters():
    """Four links, and a cart that nothing couples to them; with numbers for letters H = E."""
    names = [f"theta{i + 1}" for i in range(4)]
    q, v = vi.coordinates("X", *names)
    c = vi.Parameters(m=1.3, ell=0.7, g=9.81, M=2.0)
    x = y = lagrangian = 0
    for i in range(1, 5):
        x, y = x + c.ell * ca.sin(q[i]), y - c.ell * ca.cos(q[i])
        speeds = ca.vertcat(ca.jtimes(x, q, v), ca.jtimes(y, q, v))
        lagrangian += c.m * ca.sumsqr(speeds) / 2 - c.m * c.g * y
    s = vi.System(q, v, lagrangian + c.M * v[0] ** 2 / 2, params=c)
    found = vi.equations(s)
    [note] = [x for x in found.notes if "mass matrix" in x]
    assert note.startswith("W in the Hamiltonian is the inverse of the mass matrix of theta1, ")
    assert r"W_{23}" in found.hamiltonian.latex()
    rng = np.random.default_rng(0)
    at, speed = rng.normal(size=5), rng.normal(size=5)
    terms = ca.Function("f", [s.q, s.v, s.c], [s.mass_matrix, s.momentum, s.energy])
    mass, p, energy = (np.array(x) for x in terms(at, speed, s.default_vector))
    table = numbers(s, at, speed, speed, 0.0, [], [], p.ravel())
    inverse = np.linalg.inv(mass)
    for i in range(1, 5):
        for j in range(i, 5):
            table[sp.Symbol(f"W_{i + 1}{j + 1}", real=True)] = inverse[i, j]
    written = value(found.hamiltonian.sympy(), table)
    assert written == pytest.approx(energy[0, 0], rel=1e-12)


def test_notes_say_what_is_missing():
    q, v = vi.coordinates("x")
    relativistic = vi.equations(vi.System(q, v, -ca.sqrt(1 - v**2) - q**2))
    assert relativistic.hamiltonian is None
    assert "not quadratic in the velocities" in relativistic.notes[0]
    _, degenerate = derived("lotka_volterra")
    assert degenerate.hamiltonian is None and "singular" in degenerate.notes[0]
    with pytest.raises(vi.InputError, match="more than anybody reads"):
        vi.equations(vi.models.toda_chain().system)


def test_strange_names_break_no_latex():
    q, v = vi.coordinates("x_1_2", "50%", "a&b")
    found = vi.equations(vi.System(q, v, ca.sumsqr(v) / 2 - q[1] * q[2]))
    assert [x.name for x in found.cyclic] == ["x_1_2"]
    bare = re.sub(r"\\[%&_]", "", found.latex().replace("&\\quad", "").replace(r"&\text", ""))
    assert not re.search("[%&#]", bare)


def test_without_sympy_the_message_says_how_to_get_it(monkeypatch):
    monkeypatch.setattr("varint.notation.extra.find_spec", lambda name: None)
    system = vi.models.pendulum(m=1.5).system
    with pytest.raises(vi.VarintError, match=r"pip install varint-mechanics\[sympy\]"):
        vi.equations(system)
    with pytest.raises(vi.VarintError, match=r"pip install varint-mechanics\[sympy\]"):
        vi.from_sympy(sp.Symbol("x"), [])
    assert system._repr_latex_() is None


@pytest.mark.parametrize("name", MODELS[::2])
def test_latex_is_whole(name):
    model, found = derived(name)
    for text in (found.latex(), found._repr_latex_(), model.system._repr_latex_() or ""):
        assert text.count("{") == text.count("}") and text.count(r"\left") == text.count(r"\right")
        assert "Derivative" not in text and "Dummy" not in text and "**" not in text
    assert found._repr_latex_().startswith("$$ \\begin{aligned}")
    for _, formulas in found.sections:
        for x in formulas:
            assert x.latex() in x._repr_latex_() and str(x) == repr(x)
            assert x.sympy() is not None
            assert isinstance(x, Conserved) or str(x) in str(found)


def test_the_readme_shows_what_its_five_lines_print(capsys):
    text = (Path(__file__).resolve().parents[2] / "README.md").read_text(encoding="utf-8")
    code, shown = re.search(
        r"```python\n([^`]*vi\.equations[^`]*)```\n\n```text\n(.*?)```", text, re.S
    ).groups()
    assert len(code.strip().splitlines()) == 5
    namespace = {"vi": vi, "ca": ca}
    exec(code, namespace)
    assert capsys.readouterr().out == shown
    assert "X: p_X =" in shown.partition("Cyclic coordinates")[2]
    typeset = re.search(r"typeset:\n\n\$\$\n(.*?)\n\$\$", text, re.S)[1]
    found = vi.equations(namespace["support"]).euler_lagrange
    assert typeset == r" , \qquad ".join(e.latex() for e in found)
