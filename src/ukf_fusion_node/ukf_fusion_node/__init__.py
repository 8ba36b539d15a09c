"""Unscented Kalman filter that fuses inertial data with map matching fixes."""
