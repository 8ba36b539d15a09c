"""Intervals of statistical tests."""

import numpy as np
from scipy.stats import chi2


def within_chi_square(sum_of_squares: np.ndarray | float, freedom: int) -> bool:
    """Whether sums of squares of so many standard normal numbers, each of them, lie within the
    two-sided 99.9 % interval: one in a thousand does not by chance."""
    low, high = chi2.ppf([0.0005, 0.9995], freedom)
    return bool(((low < sum_of_squares) & (sum_of_squares < high)).all())
