"""Attitude, strapdown navigation and its errors.

rotations       quaternions and rotation vectors
preintegration  samples of a fast IMU for the strapdown
strapdown       position, velocity and attitude from specific force and angular rate
inverse         specific force and angular rate from position, velocity and attitude
ins_file        what an INS has said, in a text file
gravity         horizontal gravity that the strapdown takes off by a map
error_state     the navigator's error as a vector: order of the states, difference of estimates
error_model     linear dynamics of that error
dead_reckoning  position a fraction of an interval later
"""
