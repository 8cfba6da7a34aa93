"""Programs assembled from small kernels equal the same programs written out."""

import casadi as ca
import numpy as np
import pytest

from varint.nlp.assembly import Element, assemble

N = 5


def _elements():
    """A chain of N terms that share neighbours, a global unknown and a closing link; rows shared
    by two terms.
    """
    z, d = ca.SX.sym("z", 3), ca.SX.sym("d", 2)
    chain = Element(
        z,
        d,
        ca.sin(z[0] * z[1]) * d[0] + z[2] ** 2 * z[0],
        ca.vertcat(z[0] * z[2], ca.exp(z[1]) * d[1]),
        # in the first term z0 and z2 are the same unknown
        x=np.array([[k, k + 1, 0] for k in range(N)]),
        p=np.array([[k, N] for k in range(N)]),
        g=np.array([[k - 1 if k else -1, k] for k in range(N)]),
    )
    link = Element(
        z[:2],
        d[:1],
        z[0] * z[1] * d[0],
        z[0] ** 3 + z[1],
        x=np.array([[0, N]]),
        p=np.array([[2]]),
        g=np.array([[N - 1]]),
    )
    return [chain, link]


def _written_out(elements, x, p):
    f, g = 0, [ca.SX(0)] * N
    for e in elements:
        term = ca.Function("term", [e.variables, e.constants], [e.cost, e.rows])
        for xi, pi, gi in zip(e.x, e.p, e.g, strict=True):
            cost, rows = term(
                ca.vertcat(*(x[int(i)] for i in xi)), ca.vertcat(*(p[int(i)] for i in pi))
            )
            f += cost
            for j, row in zip(gi, ca.vertsplit(rows), strict=True):
                if j >= 0:
                    g[j] += row
    return f, ca.vertcat(*g)


@pytest.mark.parametrize("what", ["f", "g", "gradient", "jacobian", "hessian"])
def test_assembled_derivatives_equal_those_of_the_program_written_out(what):
    rng = np.random.default_rng(0)
    program = assemble(_elements(), N + 1, N + 1, N)
    x, p, sigma, mu = (
        ca.SX.sym("x", N + 1),
        ca.SX.sym("p", N + 1),
        ca.SX.sym("sigma"),
        ca.SX.sym("mu", N),
    )
    f, g = _written_out(_elements(), x, p)
    expected = {
        "f": f,
        "g": g,
        "gradient": ca.gradient(f, x),
        "jacobian": ca.jacobian(g, x),
        "hessian": ca.triu(ca.hessian(sigma * f + ca.dot(mu, g), x)[0]),
    }[what]
    point = rng.normal(size=N + 1), rng.normal(size=N + 1), 0.7, rng.normal(size=N)
    got = {
        "f": program.value(*point[:2])[0],
        "g": program.value(*point[:2])[1],
        "gradient": program.gradient(*point[:2])[1],
        "jacobian": program.jacobian(*point[:2])[1],
        "hessian": program.hessian(*point),
    }[what]
    wanted = ca.Function("wanted", [x, p, sigma, mu], [expected])(*point)
    assert np.abs(np.array(got) - np.array(wanted)).max() < 1e-14
    if what in ("jacobian", "hessian"):
        assert got.nnz() <= wanted.nnz()


def test_row_left_out_has_no_entry():
    program = assemble(_elements(), N + 1, N + 1, N)
    rows, _ = program.jacobian.sparsity_out(1).get_triplet()
    assert sorted(set(rows)) == list(range(N))


def test_connectivity_of_the_wrong_shape_is_refused():
    chain, _ = _elements()
    with pytest.raises(AssertionError, match="element"):
        Element(
            chain.variables,
            chain.constants,
            chain.cost,
            chain.rows,
            chain.x[:, :2],
            chain.p,
            chain.g,
        )
