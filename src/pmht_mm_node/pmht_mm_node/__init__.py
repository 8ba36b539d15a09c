"""Gravity map matching: batches of reduced readings to position fixes."""

from isogal.threads import one_thread

one_thread()  # before the node imports NumPy
