"""Simulated sensors: the true route, inertial sensors with the grades of the paper's Table 1, the
gravimeter and its reductions."""
