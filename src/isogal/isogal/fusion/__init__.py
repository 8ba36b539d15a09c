"""Fusion of inertial data with fixes and aids: the unscented filter.

inertial_navigator  strapdown and filter of one navigator, with a history: late measurements
measurements        what the filter is updated with, a measurement model in each file
prediction          a state through IMU intervals
state               mean and covariance
smoothed_track      a smoothed voyage as CSV, GeoJSON and GPX
mixture             several states of which one is true
alignment           the first state of a navigator that is told no attitude
coarse              first attitudes: levelling, gyrocompassing, a bank of headings
standstill          whether a vehicle that was at rest still is
outage              what is still known after a time without inertial data
sample_stream       samples of a fast IMU, one by one, as steps of the navigator
model, assumed      what the filter assumes; the same from a scenario
protection_level    radius that the horizontal error seldom exceeds

auxiliary           states beside the fifteen: what disturbs the dynamics slowly
imu_states          those of the inertial sensors

nominal             the mean as compiled functions take it, and moving it by an error state
sigma_points        sigma points: weights, propagation, moments
ukf                 the compiled filter
reference           the same filter by filterpy
"""
