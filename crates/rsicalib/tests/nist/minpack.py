"""Which starts of NIST's problems MINPACK manages.

    python minpack.py FOLDER

`FOLDER` holds the `.dat` files, as for `transcribe.py`. Prints, for each
problem and start, the digits of the worst parameter and of the sum of squares.
A start counts as managed if every parameter has six digits: `tests/lm.rs`
asks as much of our solver, on all starts but those that fail here.

The models are evaluated from the text in NIST's files and differentiated by
complex steps, exact to rounding: nothing is shared with `models.rs`.
"""

import sys
import warnings
from pathlib import Path

import numpy as np
from scipy.optimize import leastsq
from transcribe import Problem, read_all

# As tight as doubles go; MINPACK then stops where rounding stops it.
TIGHT = {"ftol": 1e-15, "xtol": 1e-15, "gtol": 0.0, "maxfev": 20_000}
FUNCTIONS = {"exp": np.exp, "cos": np.cos, "sin": np.sin, "arctan": np.arctan, "pi": np.pi}
DIGITS = 6.0


class Fit:
    """Residuals and Jacobian of one problem."""

    def __init__(self, problem: Problem) -> None:
        formula = problem.formula.replace("[", "(").replace("]", ")")
        self._formula = compile(formula, problem.name, "eval")
        y = np.array([y for y, _ in problem.data])
        self._y = {"y": np.asarray, "log[y]": np.log}[problem.response](y)
        x = np.array([x for _, x in problem.data]).T
        self._x = {"x": x[0]} if len(x) == 1 else {"x1": x[0], "x2": x[1]}

    def residuals(self, b: np.ndarray) -> np.ndarray:
        """Residuals, shape (m,)."""
        parameters = {f"b{k + 1}": value for k, value in enumerate(b)}
        # The text is NIST's formula, from a file the caller chose.
        return eval(self._formula, {**FUNCTIONS, **self._x, **parameters}) - self._y

    def jacobian(self, b: np.ndarray) -> np.ndarray:
        """Derivatives of the residuals, shape (m, n)."""
        columns = []
        for k in range(len(b)):
            step = 1e-30 * max(abs(b[k]), 1e-30)
            moved = b.astype(complex)
            moved[k] += 1j * step
            columns.append(self.residuals(moved).imag / step)
        return np.array(columns).T


def digits(found: np.ndarray, certified: np.ndarray) -> float:
    """Significant digits of the worst entry; 11 are certified."""
    error = np.max(np.abs(np.asarray(found) - certified) / np.abs(certified))
    return float(np.clip(-np.log10(np.nan_to_num(error, nan=1.0) + 1e-11), 0.0, 11.0))


def solve(fit: Fit, start: list[float], **options: object) -> tuple[np.ndarray, float, dict, int]:
    """MINPACK's answer, its sum of squares, and how it went."""
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        b, _, how, _, why = leastsq(
            fit.residuals, start, Dfun=fit.jacobian, full_output=True, **TIGHT, **options
        )
        return b, float(np.sum(fit.residuals(b) ** 2)), how, why


def main() -> None:
    failed = []
    print(f"{'':10} {'':5} {'MINPACK':^29}   {'without scaling':^16}")
    print(
        f"{'problem':10} {'start':5} {'digits of b':>11} {'of rss':>6} "
        f"{'info':>4} {'nfev':>5}   {'digits of b':>11} {'info':>4}"
    )
    for problem in read_all(Path(sys.argv[1])):
        fit = Fit(problem)
        for number, start in enumerate(problem.starts, 1):
            b, rss, how, why = solve(fit, start)
            plain, _, _, plain_why = solve(fit, start, diag=np.ones(len(start)))
            good = digits(b, np.array(problem.certified))
            print(
                f"{problem.name:10} {number:5} {good:11.1f} {digits(rss, problem.rss):6.1f} "
                f"{why:4} {how['nfev']:5}   "
                f"{digits(plain, np.array(problem.certified)):11.1f} {plain_why:4}"
                f"{'' if good >= DIGITS else '   fails: ' + np.array2string(b, precision=4)}"
            )
            if good < DIGITS:
                failed.append((problem.name, number))
    print("\nfails:", ", ".join(f"{name} from start {number}" for name, number in failed))


if __name__ == "__main__":
    main()
