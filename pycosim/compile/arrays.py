"""A CasADi SX function in, the same function over arrays of samples out, block by block, without a compiler.

CasADi evaluates a function sample by sample; here its instructions are run once a block of samples by NumPy, which is
as fast as compiled C for the few hundred operations of a drive train, and bounded in memory.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

BLOCK = 4096

_UNARY = {
    ca.OP_NEG: np.negative, ca.OP_EXP: np.exp, ca.OP_LOG: np.log, ca.OP_SQRT: np.sqrt, ca.OP_SQ: np.square,
    ca.OP_SIN: np.sin, ca.OP_COS: np.cos, ca.OP_TAN: np.tan, ca.OP_ASIN: np.arcsin, ca.OP_ACOS: np.arccos,
    ca.OP_ATAN: np.arctan, ca.OP_SINH: np.sinh, ca.OP_COSH: np.cosh, ca.OP_TANH: np.tanh, ca.OP_ASINH: np.arcsinh,
    ca.OP_FABS: np.abs, ca.OP_SIGN: np.sign, ca.OP_FLOOR: np.floor, ca.OP_CEIL: np.ceil, ca.OP_INV: np.reciprocal,
    ca.OP_NOT: np.logical_not, ca.OP_EXPM1: np.expm1, ca.OP_LOG1P: np.log1p, ca.OP_ASSIGN: np.positive,
}
_BINARY = {
    ca.OP_ADD: np.add, ca.OP_SUB: np.subtract, ca.OP_MUL: np.multiply, ca.OP_DIV: np.divide, ca.OP_POW: np.power,
    ca.OP_CONSTPOW: np.power, ca.OP_FMIN: np.minimum, ca.OP_FMAX: np.maximum, ca.OP_LT: np.less,
    ca.OP_LE: np.less_equal,
    ca.OP_EQ: np.equal, ca.OP_NE: np.not_equal, ca.OP_AND: np.logical_and, ca.OP_OR: np.logical_or,
    ca.OP_ATAN2: np.arctan2, ca.OP_HYPOT: np.hypot, ca.OP_COPYSIGN: np.copysign, ca.OP_FMOD: np.fmod,
}


def _if_else_zero(condition, value, out=None):
    """CasADi's conditional product: value where the condition holds, else exactly zero (also for infinite values)."""
    if out is None:
        return np.where(condition, value, 0.0)
    drop = np.equal(condition, 0.0)  # before ``out``, which may be the condition's own buffer, is written
    np.copyto(out, value)
    np.putmask(out, np.broadcast_to(drop, out.shape), 0.0)
    return out


def _twice(value, out=None):
    return np.multiply(value, 2.0, out=out)


class ArrayFunction:
    """A scalar-input SX function evaluated over arrays.

    Parameters
    ----------
    function : casadi.Function
        Inputs of any shape; every element is an argument, in column order. One output or several; every structural
        nonzero is a row of the result.
    """

    def __init__(self, function):
        self.function = function
        self.offsets = np.cumsum([0] + [function.nnz_in(i) for i in range(function.n_in())])
        self.out_offsets = np.cumsum([0] + [function.nnz_out(i) for i in range(function.n_out())])
        self.program = [self._instruction(k) for k in range(function.n_instructions())]
        self.work_size = function.sz_w() + 1

    def _instruction(self, k):
        f = self.function
        op, out, inp = f.instruction_id(k), f.instruction_output(k), f.instruction_input(k)
        if op == ca.OP_INPUT:
            return "in", out[0], int(self.offsets[inp[0]] + inp[1]), None
        if op == ca.OP_OUTPUT:
            return "out", int(self.out_offsets[out[0]] + out[1]), inp[0], None
        if op == ca.OP_CONST:
            return "const", out[0], float(f.instruction_constant(k)), None
        if op in _BINARY:
            return _BINARY[op], out[0], inp[0], inp[1]
        if op == ca.OP_IF_ELSE_ZERO:
            return _if_else_zero, out[0], inp[0], inp[1]
        if op == ca.OP_TWICE:
            return _twice, out[0], inp[0], None
        return _UNARY[op], out[0], inp[0], None

    @property
    def rows(self):
        """Number of output rows."""
        return int(self.out_offsets[-1])

    def blocks(self, arguments, n, block=BLOCK):
        """Yield the result block by block, in a buffer that is reused.

        Parameters
        ----------
        arguments : list of float or ndarray, shape (n,)
            One an argument of the function.
        n : int
            Number of samples.
        block : int
            Samples a block.

        Yields
        ------
        where : slice
            Samples of the block.
        result : ndarray, shape (rows, m)
            To be read before the next block is asked for.
        """
        buffers = np.empty((self.work_size, block))
        result = np.empty((self.rows, block))
        work = [None] * self.work_size
        with np.errstate(all="ignore"):
            for start in range(0, n, block):
                stop = min(start + block, n)
                m = stop - start
                self._run(arguments, slice(start, stop), work, buffers[:, :m], result[:, :m])
                yield slice(start, stop), result[:, :m]

    def _run(self, arguments, where, work, buffers, result):
        for op, out, a, b in self.program:
            if op == "in":
                value = arguments[a]
                work[out] = value[where] if isinstance(value, np.ndarray) else value
            elif op == "out":
                result[out] = work[a]
            elif op == "const":
                work[out] = a
            elif b is None:
                x = work[a]
                work[out] = op(x, out=buffers[out]) if isinstance(x, np.ndarray) else op(np.float64(x))
            else:
                x, y = work[a], work[b]
                if isinstance(x, np.ndarray) or isinstance(y, np.ndarray):
                    work[out] = op(x, y, out=buffers[out])
                else:
                    work[out] = op(np.float64(x), np.float64(y))

    def __call__(self, arguments, n):
        """Evaluate over all samples.

        Parameters
        ----------
        arguments : list of float or ndarray, shape (n,)
            One an argument of the function.
        n : int
            Number of samples.

        Returns
        -------
        ndarray, shape (rows, n)
        """
        result = np.empty((self.rows, n))
        for where, block in self.blocks(arguments, n):
            result[:, where] = block
        return result
