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
    """CasADi's conditional product: value where the condition holds, else exactly zero (also for infinite values).

    In an array of its own: to write in a given one what a condition lets through takes twice as long.
    """
    return np.where(condition, value, 0.0)


def _twice(value, out=None):
    return np.multiply(value, 2.0, out=out)


class _Plan:
    """The instructions of a function in two parts, for arguments of which it is known which are arrays.

    What hangs on numbers alone is worked out once a call, the rest once a block. Values have numbers of their own,
    buffers are those of the function.
    """

    def __init__(self, program, arrays):
        self.start, self.given, self.once, self.sliced, self.steps, self.filled = [], [], [], [], [], []
        of_slot, is_array = {}, []

        def new(slot, array, value=None):
            of_slot[slot] = len(self.start)
            self.start.append(value)
            is_array.append(array)
            return of_slot[slot]

        for op, out, a, b in program:
            if op == "in":
                (self.sliced if arrays[a] else self.given).append((new(out, arrays[a]), a))
            elif op == "const":
                new(out, False, np.float64(a))
            elif op == "out":
                source = of_slot[a]
                if is_array[source]:
                    self.steps.append((None, out, source, None, None))
                else:
                    self.filled.append((out, source))
            else:
                x, y = of_slot[a], None if b is None else of_slot[b]
                array = is_array[x] or (y is not None and is_array[y])
                value = new(out, array)
                if array:
                    self.steps.append((op, value, x, y, out))
                else:
                    self.once.append((op, value, x, y))

    def begin(self, arguments):
        """Values that are the same in all blocks."""
        values = self.start.copy()
        for value, a in self.given:
            values[value] = np.float64(arguments[a])
        for op, value, x, y in self.once:
            values[value] = np.float64(op(values[x]) if y is None else op(values[x], values[y]))  # truth adds up
        return values

    def block(self, values, arguments, where, buffers, result):
        """Work one block out, a row of result each output."""
        for value, a in self.sliced:
            values[value] = arguments[a][where]
        for op, value, x, y, buffer in self.steps:
            if op is None:
                result[value] = values[x]
            elif y is None:
                values[value] = op(values[x], out=buffers[buffer])
            else:
                values[value] = op(values[x], values[y], out=buffers[buffer])
        for row, x in self.filled:
            result[row] = values[x]


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
        self.plans = {}

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
        arrays = tuple(isinstance(a, np.ndarray) for a in arguments)
        if arrays not in self.plans:
            self.plans[arrays] = _Plan(self.program, arrays)
        plan, most = self.plans[arrays], min(block, n)
        buffers, result = np.empty((self.work_size, most)), np.empty((self.rows, most))
        with np.errstate(all="ignore"):
            values = plan.begin(arguments)
            for start in range(0, n, block):
                m = min(block, n - start)
                where, rows = slice(start, start + m), result[:, :m]
                plan.block(values, arguments, where, [*buffers[:, :m]], rows)
                yield where, rows

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
