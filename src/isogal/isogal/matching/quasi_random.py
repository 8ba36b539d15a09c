"""Quasi-random points: Sobol's sequence (1967) with the direction numbers of Joe and Kuo (2008,
SIAM J. Sci. Comput. 30:2635), scrambled.

Scrambling is Matoušek's (1998, J. Complexity 14:527): each coordinate's binary digits are
multiplied by a random lower triangular matrix and shifted by random digits, modulo 2. It keeps the
points' even spread and takes away the order that the plain sequence has. scipy.stats.qmc has the
like, at 50 MB of memory in every node.
"""

from functools import lru_cache
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from isogal.arrays import Array

Bits = NDArray[np.uint8]

DIGITS = 32
"""Binary digits of a coordinate."""
_PRIMITIVE = (
    (0b11, (1,)),
    (0b111, (1, 3)),
    (0b1011, (1, 3, 1)),
    (0b1101, (1, 1, 1)),
    (0b10011, (1, 1, 3, 3)),
)
"""Primitive polynomial modulo 2 and first direction numbers of the second to sixth coordinate (Joe
and Kuo 2008, new-joe-kuo-6)."""
MOST_DIMENSIONS = 1 + len(_PRIMITIVE)


def sobol(count: int, dimensions: int, seed: int) -> Array:
    """Return (count, dimensions) points in the open unit cube; any seed gives points as even as
    any other.

    A power of two as `count` gives the most even points. Coordinates are multiples of 2⁻³² less
    one half of that, so never 0 or 1.
    """
    if not 1 <= dimensions <= MOST_DIMENSIONS or not 1 <= count <= 2**DIGITS:
        raise ValueError(
            f"{count} points of {dimensions} coordinates; at most {MOST_DIMENSIONS} coordinates"
        )
    random = np.random.default_rng(seed)
    needed = max(int(count - 1).bit_length(), 1)
    index: Bits = (np.arange(count)[:, None] >> np.arange(needed) & 1).astype(np.uint8)
    points = np.empty((count, dimensions))
    for dimension in range(dimensions):
        scramble = np.tril(random.integers(0, 2, (DIGITS, DIGITS), dtype=np.uint8), -1) + np.eye(
            DIGITS, dtype=np.uint8
        )
        shift = random.integers(0, 2, DIGITS, dtype=np.uint8)
        generator = scramble @ _directions(dimension, needed) & 1
        digits = (index @ generator.T & 1) ^ shift
        points[:, dimension] = digits @ 0.5 ** np.arange(1, DIGITS + 1) + 0.5 ** (DIGITS + 1)
    return points


def normal(points: Array) -> Array:
    """Return what standard normal variables have the given cumulative probabilities, any shape."""
    inverse = NormalDist().inv_cdf
    return np.array([inverse(p) for p in points.flat]).reshape(points.shape)


@lru_cache(maxsize=8)
def standard_normal(count: int, dimensions: int) -> Array:
    """Return (count, dimensions) fixed standard normal points; read-only."""
    points = normal(sobol(count, dimensions, 20230102))
    points.setflags(write=False)
    return points


def _directions(dimension: int, count: int) -> Bits:
    """Return the first `count` direction numbers of a coordinate as columns of binary digits
    (DIGITS, count), the first digit on top.
    """
    if dimension == 0:  # van der Corput's sequence
        return np.eye(DIGITS, count, dtype=np.uint8)
    polynomial, first = _PRIMITIVE[dimension - 1]
    degree = len(first)
    numbers = list(first)
    for k in range(degree, count):
        # Joe and Kuo (2008), eq. 2: m_k = sum of 2^i a_i m_(k-i), modulo 2 digit by digit, and
        # m_(k-degree)
        number = numbers[k - degree]
        for i in range(1, degree + 1):
            if polynomial >> (degree - i) & 1:
                number ^= numbers[k - i] << i
        numbers.append(number)
    columns = [number << (DIGITS - 1 - k) for k, number in enumerate(numbers[:count])]
    return np.array(
        [[column >> (DIGITS - 1 - row) & 1 for column in columns] for row in range(DIGITS)],
        dtype=np.uint8,
    )
