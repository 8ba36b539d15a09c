"""Unscented Kalman filter that fuses inertial data with map matching fixes."""

from isogal.threads import one_thread

one_thread()  # before the node imports NumPy
