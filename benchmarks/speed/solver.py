"""The damped steps of the fits against SciPy's solvers, on all fits of one diagnosis of a study.

    python -m benchmarks.speed.solver STUDY

Each solver starts where the fit did, within the same bounds. Told are the evaluations of the moments that each asked
for, their seconds, and in how many fits it ended a thousandth or more above the least that any of them found.
"""

import argparse
import time

import numpy as np
from scipy import optimize

import pycosim as pc
from pycosim.diagnosis import decide
from pycosim.fit import damped, least_squares
from pycosim.fit.least_squares import MARGIN

SCIPY = ("trf", "dogbox")
ABOVE = 1e-3


def scipy(method, gram, x, scale, low, high, most):
    """SciPy's least squares on the root of the moments, which has their squares and their derivatives."""
    known = {}

    def root(z):
        if z.tobytes() not in known:
            known.clear()
            values, vectors = np.linalg.eigh(gram(z))
            known[z.tobytes()] = np.sqrt(np.maximum(values, 0))[:, None] * vectors.T
        return known[z.tobytes()]

    return optimize.least_squares(
        lambda z: -root(z)[:, -1], x, jac=lambda z: root(z)[:, :-1], bounds=(low, high), x_scale=scale, method=method,
        xtol=1e-7, ftol=damped.ENOUGH, gtol=1e-12, max_nfev=most).x


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("study")
    dataset = pc.open(parser.parse_args().study).dataset
    told, ends, real = {}, [], least_squares._solve

    def timed(name, gram, work):
        asked, start = [], time.perf_counter()

        def counted(z):
            asked.append(1)
            return gram(z)

        x = work(counted)
        count, seconds = told.get(name, (0, 0.0))
        told[name] = count + len(asked), seconds + time.perf_counter() - start
        return x

    def solve(gram, x, free, variables, most):
        scale = np.array([variables[n].nominal for n in free])
        low, high = (np.array([getattr(variables[n], end) for n in free]) for end in ("min", "max"))
        begin = np.clip(x, low + MARGIN * scale, high - MARGIN * scale)
        found = {"damped": timed("damped", gram, lambda g: real(g, x, free, variables, most))}
        for method in SCIPY if free else ():
            found[method] = timed(method, gram, lambda g, m=method: scipy(m, g, begin, scale, low, high, most))
        ends.append({name: gram(x)[-1, -1] for name, x in found.items()})
        return found["damped"]

    least_squares._solve = solve
    fit = least_squares.fit(dataset, dataset.base)
    decide.diagnose(dataset, dataset.base, fit)
    print(f"{len(ends)} fits")
    print(f"{'solver':8s} {'evaluations':>12s} {'ratio':>7s} {'seconds':>8s} {'above the least':>16s}")
    for name, (count, seconds) in told.items():
        above = sum(e[name] > (1 + ABOVE) * min(e.values()) for e in ends)
        print(f"{name:8s} {count:12d} {count / told['damped'][0]:7.2f} {seconds:8.1f} {above:16d}")


if __name__ == "__main__":
    main()
