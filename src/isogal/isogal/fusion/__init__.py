"""Fusion of inertial data with fixes: the unscented filter.

model           what the filter assumes about sensors and aids
state           mean and covariance of many runs
navigator       prediction and updates, for many runs at once
buffered        a navigator of one run that takes fixes of any age
fix             the one order in which a fix is applied
gate            which measurements are rejected
sample_stream   samples of a fast IMU, one by one, as steps of the navigator
imu_states      auxiliary states of the inertial sensors
aiding          readings of height and velocity sensors
height_states   errors of a height sensor as states of the filter
velocity_states errors of a velocity aid, and current or wind
protection_level  radius that the horizontal error seldom exceeds
outage          what is still known after a time without inertial data
belief          several states of which one is true, and what fixes say of them

auxiliary       states beside the fifteen: what disturbs the dynamics slowly
gravity_states  those of the horizontal gravity that is left

nominal         the mean as compiled functions take it, and moving it by an error state
sigma_points    sigma points: weights, propagation, moments
ukf             the compiled filter
reference       the same filter by filterpy
"""
