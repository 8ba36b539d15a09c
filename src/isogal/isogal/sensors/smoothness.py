"""How smooth a cubic smoothing spline should be, by generalised cross-validation (Craven and Wahba
1979), in time and memory that grow as the number of values.

`scipy.interpolate.make_smoothing_spline` finds the same by loops of Python, which take minutes for
a recording of a day at 1 Hz."""

import numpy as np

from isogal.arrays import Array
from isogal.compiled import kernel


def smoothness(abscissa: Array, values: Array, weight: Array) -> float:
    """Return the factor of the integral of the squared second derivative that makes the spline's
    generalised cross-validation score least: the `lam` of `make_smoothing_spline`.

    Parameters
    ----------
    abscissa : (N,) array
        Increasing; N is 5 at least. The search, as scipy's, ends at N in its unit cubed.
    values : (N,) array
    weight : (N,) array
        Of the values' squared residuals, positive.
    """
    from scipy.optimize import minimize_scalar

    step, variance = np.diff(abscissa), 1.0 / weight
    values = np.ascontiguousarray(values)  # as a column of a table it would be compiled anew
    found = minimize_scalar(
        lambda factor: _score(factor, step, values, variance),
        bounds=(0, len(abscissa)),
        method="bounded",
    )
    return float(found.x)


@kernel
def _score(factor: float, step: Array, values: Array, variance: Array) -> float:
    """Return the score of a natural spline in Reinsch's form (1967): with second differences Q'y,
    the residuals are f V Q c, where (R + f Q'VQ) c = Q'y, and I less the hat matrix has the trace
    of f (R + f Q'VQ)^-1 Q'VQ, for which five bands of the inverse are enough (Hutchinson and
    de Hoog 1985). Both without the factor f, which the score does not need."""
    n = len(step) - 1
    second = np.zeros((n, 3))  # Q', its rows i, i + 1, i + 2
    for i in range(n):
        second[i, 0], second[i, 2] = 1.0 / step[i], 1.0 / step[i + 1]
        second[i, 1] = -second[i, 0] - second[i, 2]
    product = np.zeros((n, 3))  # Q'VQ, and below the factors of the whole: diagonal and two bands
    factors = np.zeros((n, 3))
    solution = np.zeros(n)
    for i in range(n):
        for band in range(min(3, n - i)):
            for k in range(3 - band):
                product[i, band] += (
                    second[i, k + band] * variance[i + k + band] * second[i + band, k]
                )
            factors[i, band] = factor * product[i, band]
        factors[i, 0] += (step[i] + step[i + 1]) / 3.0
        if i + 1 < n:
            factors[i, 1] += step[i + 1] / 6.0
        for k in range(3):
            solution[i] += second[i, k] * values[i + k]
    for i in range(n):  # the factors L D L', and L^-1 Q'y
        for back in range(1, min(2, i) + 1):
            pivot = factors[i - back, 0] * factors[i - back, back]
            factors[i, 0] -= pivot * factors[i - back, back]
            if back == 1:
                factors[i, 1] -= pivot * factors[i - 1, 2]
            solution[i] -= factors[i - back, back] * solution[i - back]
        factors[i, 1] /= factors[i, 0]
        factors[i, 2] /= factors[i, 0]
    inverse = np.zeros((n + 2, 3))  # its diagonal and two bands
    trace = 0.0
    for i in range(n - 1, -1, -1):
        solution[i] /= factors[i, 0]
        for ahead in range(1, min(2, n - 1 - i) + 1):
            solution[i] -= factors[i, ahead] * solution[i + ahead]
        one, two = factors[i, 1], factors[i, 2]
        inverse[i, 1] = -one * inverse[i + 1, 0] - two * inverse[i + 1, 1]
        inverse[i, 2] = -one * inverse[i + 1, 1] - two * inverse[i + 2, 0]
        inverse[i, 0] = 1.0 / factors[i, 0] - one * inverse[i, 1] - two * inverse[i, 2]
        trace += inverse[i, 0] * product[i, 0]
        trace += 2.0 * (inverse[i, 1] * product[i, 1] + inverse[i, 2] * product[i, 2])
    total = 0.0
    for j in range(n + 2):
        residual = 0.0
        for k in range(max(0, j - n + 1), min(2, j) + 1):
            residual += second[j - k, k] * solution[j - k]
        total += (variance[j] * residual) ** 2
    return total / trace**2
