"""Random streams: one independent generator per (seed, run, purpose).

A stream depends on nothing else, so a run draws the same numbers alone, in a batch of any size, on
any worker."""

import zlib

import numpy as np


def generator(seed: int, run: int, stream: str) -> np.random.Generator:
    """Return the generator of one purpose in one run.

    Parameters
    ----------
    seed : int
        Seed of the scenario, >= 0.
    run : int
        Index of the run, >= 0.
    stream : str
        Purpose, for example ``"imu_noise"``; its CRC-32 is the last word of the spawn key.
    """
    return np.random.Generator(
        np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(run, zlib.crc32(stream.encode()))))
    )
