"""Simulated vehicle: clock, IMU, ground truth and the unaided INS."""
