"""Simulated gravimeter and its reductions with the navigator's estimate."""

from isogal.threads import one_thread

one_thread()  # before the node imports NumPy
