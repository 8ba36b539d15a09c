"""Chi-square distribution: how probable a misfit this large is. scipy has it, for 13 MB of memory
in a node (scipy.stats: 60 MB).
"""

import math

_PRECISION = 1e-15
_MOST_TERMS = 100_000


def survival(value: float, freedom: float) -> float:
    """Return P(X > value) for a chi-square variable with `freedom` > 0 degrees of freedom, which
    need not be whole.

    The regularised incomplete gamma function Q(freedom / 2, value / 2): below the mean by the
    series of P = 1 - Q (DLMF 8.11.4), above it by the continued fraction of Q (even part of DLMF
    8.9.2; evaluated as Lentz 1976, Appl. Opt. 15:668, does). NaN gives NaN.
    """
    a, x = 0.5 * freedom, 0.5 * value
    if x <= 0.0:
        return 1.0
    if math.isinf(x):
        return 0.0
    scale = math.exp(a * math.log(x) - x - math.lgamma(a))
    if x < a + 1.0:
        term = total = 1.0 / a
        for k in range(1, _MOST_TERMS):
            term *= x / (a + k)
            total += term
            if term < _PRECISION * total:
                break
        return 1.0 - scale * total
    b = x + 1.0 - a
    d = 1.0 / b
    c, fraction = math.inf, d
    for k in range(1, _MOST_TERMS):
        numerator = k * (a - k)
        b += 2.0
        d = 1.0 / (b + numerator * d)
        c = b + numerator / c
        fraction *= c * d
        if abs(c * d - 1.0) < _PRECISION:
            break
    return scale * fraction
