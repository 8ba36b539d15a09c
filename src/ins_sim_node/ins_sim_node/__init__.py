"""Simulated vehicle: clock, IMU, ground truth and the unaided INS."""

from isogal.threads import one_thread

one_thread()  # before the node imports NumPy
