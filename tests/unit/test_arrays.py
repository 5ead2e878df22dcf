"""A graph over arrays is what CasADi says of each sample, whichever of its arguments are numbers."""

import itertools

import casadi as ca
import numpy as np
import pytest

from pycosim.compile.arrays import ArrayFunction

N = 11
RNG = np.random.default_rng(0)
VALUES = [RNG.normal(size=N) for _ in range(3)]


def graph():
    """Truths that are added and multiplied, branches, a constant, an argument that goes straight through."""
    x, y, z = ca.SX.sym("x"), ca.SX.sym("y"), ca.SX.sym("z")
    truths = (x > 0) + (y > 0) + (z > -5)
    branch = ca.if_else(x < y, ca.exp(x) * truths, 2 * y - truths)
    return ca.Function("f", [x, y, z], [ca.vertcat(
        branch, truths, truths - 1, ca.fmin(x, z) ** 2, ca.tanh(z) / (1 + y ** 2), 7.0, z, ca.logic_not(x > y) - 1,
        ca.jacobian(ca.fabs(x * y) * ca.sign(z), ca.vertcat(x, y)).T)])


@pytest.mark.parametrize("block", [4, 4096])
@pytest.mark.parametrize("numbers", [some for k in range(4) for some in itertools.combinations(range(3), k)])
def test_it_is_what_casadi_says_of_each_sample(numbers, block):
    f = graph()
    given = [float(v[0]) if k in numbers else v for k, v in enumerate(VALUES)]
    samples = [[v if k in numbers else v[i] for k, v in enumerate(given)] for i in range(N)]
    known = np.array([np.array(f(*sample), dtype=float).ravel() for sample in samples]).T
    function = ArrayFunction(f)
    found = np.empty((function.rows, N))
    for where, rows in function.blocks(given, N, block):
        found[:, where] = rows
    assert found == pytest.approx(known, rel=1e-14)
    assert function(given, N) == pytest.approx(known, rel=1e-14)


def test_the_same_function_takes_numbers_and_arrays_in_turn():
    function = ArrayFunction(graph())
    once = function(VALUES, N)
    function([0.1, 0.2, 0.3], N)
    assert np.array_equal(function(VALUES, N), once)
