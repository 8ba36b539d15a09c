"""Rows of tables that have something in common, such as readings in one block of a survey, and
their means."""

import math
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array, Integers


@dataclass(frozen=True, slots=True, eq=False)
class Groups:
    """Readings (N,) that have something in common, in G groups."""

    first: Integers
    """(G,) row of the first of each."""
    of: Integers
    """(N,) group of each reading."""
    count: Array
    """(G,) readings of each."""

    @classmethod
    def by(cls, *keys: Array | Integers) -> "Groups":
        """Return those that have the same integers in all keys, (N,) or (N, K), in the order of
        these."""
        _, first, of, count = np.unique(
            np.column_stack(keys).astype(np.int64),
            axis=0,
            return_index=True,
            return_inverse=True,
            return_counts=True,
        )
        return cls(first, of.reshape(-1), count.astype(np.float64))

    def mean(self, values: Array) -> Array:
        """Return (G, ...) means of values (N, ...)."""
        columns = values.reshape(len(values), math.prod(values.shape[1:])).T
        sums = [np.bincount(self.of, column, len(self.count)) for column in columns]
        return np.array(sums / self.count).T.reshape(-1, *values.shape[1:])
