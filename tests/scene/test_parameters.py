"""Parameters as CasADi users write them: their own symbols, and values by symbol or by name, in
every verb.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import varint as vi

Q, V = vi.coordinates("x", "y")
M, K, PUSH = ca.SX.sym("m"), ca.SX.sym("k"), ca.SX.sym("push")
CENTRE, STIFF = ca.SX.sym("centre", 2), ca.SX.sym("stiff", 2, 2)
SPRING = M * ca.sumsqr(V) / 2 - K * ca.sumsqr(Q) / 2
START = dict(q0=[1.0, 0.0], v0=[0.0, 1.0])


def scene(**more) -> vi.System:
    return vi.System(Q, V, SPRING, params={M: 1.0, K: 3.0}, **more)


FREE = scene()
DRIVEN = scene(force=ca.vertcat(PUSH, 0), control=PUSH)
HELD = scene(constraint=Q[1] * (1 - K / 5) - Q[0] ** 2)
TO_REST = dict(duration=1.0, steps=3, cost=PUSH**2, end=dict(q=[0, None]))

# each of them says in numbers what became of the parameters that it was given
VERBS = {
    "simulate": lambda c: vi.simulate(FREE, **START, h=0.1, steps=5, params=c).q,
    "to a tolerance": lambda c: vi.simulate(FREE, **START, duration=1.0, params=c).q[-1],
    "variable steps": lambda c: (
        vi.simulate(FREE, **START, h=0.1, steps=5, time_scale=1 + K * Q[0] ** 2, params=c).q
    ),
    "ensemble": lambda c: vi.ensemble(FREE, q0=np.eye(2), v0=[0, 0], h=0.1, steps=5, params=c).q,
    "least_action": lambda c: (
        vi.least_action(FREE, q0=[0, 0], q_end=[1, 1], duration=1.0, steps=4, params=c).q
    ),
    "paths": lambda c: (
        vi.paths(FREE, q0=[0, 0], q_end=[1, 1], duration=1.0, steps=4, starts=1, params=c)[0].q
    ),
    "optimal_control": lambda c: vi.optimal_control(DRIVEN, **START, **TO_REST, params=c).u,
    "multistart": lambda c: vi.multistart(vi.Phase(DRIVEN, **TO_REST, **START, params=c), 1)[0].u,
    "project": lambda c: vi.project(HELD, [1.0, 1.0], [0.0, 1.0], params=c)[0],
    "start_momentum": lambda c: vi.start_momentum(
        FREE, vi.midpoint(), q0=[0, 0], q1=[0.1, 0], h=0.1, params=c
    ),
    "symmetries": lambda c: vi.symmetries(FREE, params=c)[0].params,
    "noether": lambda c: vi.noether(FREE, [-Q[1], Q[0]], params=c).params,
    "energy_slope": lambda c: (
        vi.diagnostics.energy_slope(FREE, vi.gauss(2), **START, h=0.1, steps=60, params=c).energy
    ),
    "convergence": lambda c: (
        vi.diagnostics.convergence(
            FREE, vi.gauss(2), **START, duration=1.0, steps=(4, 8), params=c
        ).q_error
    ),
}
TO_REST_PHASE = {name: x for name, x in TO_REST.items() if name != "progress"}


@pytest.mark.parametrize("verb", VERBS)
def test_values_by_symbol_are_values_by_name_in_every_verb(verb):
    by_name = VERBS[verb]({"k": 2.0})
    for given in ({K: 2.0}, {K + 0: 2.0}, [(K, 2.0)], [("k", 2.0)], {"m": 1.0, K: 2.0}):
        np.testing.assert_array_equal(VERBS[verb](given), by_name)
    assert not np.array_equal(VERBS[verb]({}), by_name)


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({ca.SX.sym("foreign"): 1.0}, r"unknown parameters \['foreign'\]; known: \['m', 'k'\]"),
        ({Q[0]: 1.0}, r"unknown parameters \['x'\]"),
        ({K: 2.0, "k": 3.0}, "two values for 'k'"),
        ({ca.MX.sym("k"): 2.0}, r"the key MX\(k\); keys are names or symbols"),
        ({2 * K: 2.0}, "keys are names or symbols"),
        ({3: 2.0}, "the key 3"),
        ([([], 2.0)], r"the key \[\]"),
        ([(ca.vertcat(M, K), [1.0, 2.0])], "not one symbol with a name"),
        ("k", "must be a dictionary of names or symbols and values, or a list of such pairs"),
        ([1.0, 2.0], "must be a dictionary"),
        ({K: [1.0, 2.0]}, r"'k'"),
    ],
)
def test_every_verb_refuses_what_names_no_parameter(verb, given, message):
    if verb == "ensemble" and message == "'k'":
        return  # one value a member
    with pytest.raises(vi.InputError, match=message):
        VERBS[verb](given)


def test_free_parameters_go_by_symbol_or_name():
    """Of all stiffnesses the one whose motion ends at rest in the middle needs no push."""
    end = dict(q=[0.0, None], v=[None, None])
    problem = dict(duration=1.0, steps=6, cost=PUSH**2, end=end, q0=[1.0, 0.0], v0=[0.0, 0.0])
    found = [
        vi.optimal_control(DRIVEN, vi.gauss(4), **problem, params=c, progress=False)
        for c in ({K: vi.free(2.0, 1.0, 4.0)}, {"k": vi.free(2.0, 1.0, 4.0)})
    ]
    np.testing.assert_array_equal(found[0].c, found[1].c)
    assert float(found[0].parameters["k"]) == pytest.approx(np.pi**2 / 4, abs=1e-5)
    assert found[0].cost < 1e-9


def general(params) -> vi.System:
    return vi.System(
        Q, V, M * ca.sumsqr(V) / 2 - ca.bilin(STIFF, Q - CENTRE, Q - CENTRE), params=params
    )


def test_vectors_and_matrices_of_symbols_come_in_pairs():
    values = dict(m=1.5, centre=[0.1, 0.2], stiff=[[2.0, 0.5], [0.25, 1.0]])
    own = general(list(zip((M, CENTRE, STIFF), values.values(), strict=True)))
    c = vi.Parameters(**values)
    named = vi.System(
        Q,
        V,
        c.m * ca.sumsqr(V) / 2 - ca.bilin(c.stiff, Q - c.centre, Q - c.centre),
        params=c,
    )
    grid = START | dict(h=0.1, steps=5)
    one, other = (vi.simulate(system, **grid) for system in (own, named))
    np.testing.assert_array_equal(one.q, other.q)
    assert {name: x.tolist() for name, x in one.parameters.items()} == values
    moved = dict(centre=[1.0, 2.0], stiff=[[1.0, 2.0], [3.0, 4.0]])
    expected = vi.simulate(named, **grid, params=moved).q
    for given in (
        [(CENTRE, moved["centre"]), (STIFF, moved["stiff"])],
        [(CENTRE, ca.DM(moved["centre"])), (STIFF, ca.DM(moved["stiff"]))],
        [(c.centre, moved["centre"]), ("stiff", np.array(moved["stiff"]))],
    ):
        np.testing.assert_array_equal(vi.simulate(own, **grid, params=given).q, expected)
    many = vi.ensemble(own, **grid, params=[(CENTRE, [[0.1, 0.2], [1.0, 2.0]]), *[(M, 1.5)]])
    np.testing.assert_allclose(many.q[0], one.q, rtol=1e-14, atol=1e-14)


def test_twelve_entries_keep_their_order():
    a = ca.SX.sym("a", 12)
    q, v = vi.coordinates("x")
    system = vi.System(q, v, v**2 / 2 - q * ca.dot(a, np.arange(12)), params=[(a, np.arange(12))])
    motion = vi.simulate(system, q0=0, v0=0, h=0.5, steps=2)
    assert motion.q[-1, 0] == pytest.approx(-506 / 2)


@pytest.mark.parametrize(
    ("params", "message"),
    [
        ({"m": 1.0}, r"the key 'm'; give the symbol itself, \{m: 1.0\}"),
        ({ca.MX.sym("m"): 1.0}, r"the key MX\(m\); give the symbol itself"),
        ({2 * M: 1.0}, "keys are names or symbols"),
        ({M: 1.0, ca.SX.sym("m"): 2.0}, "two symbols of the name 'm'"),
        ({M: "heavy"}, "parameter 'm' must be a number"),
        ({M: np.nan}, "parameter 'm' is not finite"),
        ({M: [1.0, 2.0]}, r"parameter 'm' has shape \(2,\); its symbol has \(\)"),
        ([(CENTRE, 1.0)], r"parameter 'centre' has shape \(\); its symbol has \(2,\)"),
        ([(STIFF, np.eye(3))], r"parameter 'stiff' has shape \(3, 3\); its symbol has \(2, 2\)"),
        ([(ca.vertcat(M, K), [1, 2])], "not one symbol with a name"),
        ([(ca.SX(0, 1), [])], "not one symbol with a name"),
        ([(ca.SX.sym("d", ca.Sparsity.diag(2)), np.eye(2))], "keys are names or symbols"),
        ([(M, 1.0, 2.0)], "must be Parameters, or a dictionary"),
        (3, "params must be Parameters, or a dictionary from symbols to default values"),
        ({M: 1.0, Q[0]: 1.0}, r"the names \['x'\] are used for more than one symbol"),
        ({M: 1.0}, r"undeclared symbols \['k'\] in the Lagrangian"),
    ],
)
def test_what_are_no_parameters_of_a_scene_is_refused(params, message):
    with pytest.raises(vi.InputError, match=message):
        vi.System(Q, V, SPRING, params=params)


def test_a_loaded_scene_knows_the_symbols_by_their_names(tmp_path):
    motion = vi.simulate(FREE, **START, h=0.1, steps=5, params={K: 2.0})
    motion.save(tmp_path / "motion.npz")
    again = vi.load(tmp_path / "motion.npz")
    assert again.parameters == motion.parameters
    longer = [
        vi.simulate(m.system, **START, h=0.1, steps=9, params={K: 5.0}) for m in (motion, again)
    ]
    np.testing.assert_array_equal(longer[0].q, longer[1].q)


@pytest.mark.parametrize("name", ["self", "_hidden", "q", "class"])
def test_parameters_may_have_any_name(name):
    symbol = ca.SX.sym(name)
    q, v = vi.coordinates("x")
    own = vi.System(q, v, symbol * v**2 / 2, params={symbol: 2.0})
    c = vi.Parameters(**{name: 2.0})
    named = vi.System(q, v, getattr(c, name) * v**2 / 2, params=c)
    for system in (own, named):
        assert vi.simulate(system, q0=0, v0=1, h=1, steps=1, params={name: 3.0}).p[0, 0] == 3.0
        scaled = dict(time_scale=1 + q**2, params={symbol: 3.0})
        assert vi.simulate(system, q0=0, v0=1, h=0.1, steps=2, **scaled).p[0, 0] == 3.0


def test_none_is_no_bound_of_a_free_quantity():
    above, below = vi.free(1.0, 0.01, None), vi.free([1.0, 2.0], None, [None, 3.0])
    assert (above.lower, above.upper) == (0.01, np.inf)
    assert (below.lower == -np.inf).all() and below.upper.tolist() == [np.inf, 3.0]
    for wrong in ((None, 0.0, 1.0), ("1", 0.0, 2.0), (1.0, "0", 2.0)):
        with pytest.raises(vi.InputError, match=r"takes numbers|needs numbers"):
            vi.free(*wrong)
