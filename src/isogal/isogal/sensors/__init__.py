"""Simulated sensors, and the reductions of their readings to values of a map.

trajectory      the true route, and what a perfect inertial sensor measures on it
recorded_track  the same along a recorded track
smoothness      how smooth the splines of its positions are
imu             inertial sensors with the errors of a data sheet, and what perfect ones measure
imu_model       what a navigator assumes of them
barometer       height from pressure, in air and in water
velocity_aid    velocity in body axes: Doppler log, odometer, log, airspeed
initial         the navigator's first state, with its errors
ins_solution    the solution of an INS: what it says
scans           which readings of an instrument are scans, and which scans are missing
noise           random errors of readings: white, outliers, bias, correlated, walk
reduction       what every instrument of a mapped field provides
gravimeter      gravity and its disturbance
gravimeter_errors  all that it adds to its readings, and which are missing
platform        its platform, where that is not level
lag             its low-pass filter and delay
magnetometer    the anomaly of the total magnetic field
altimeter       terrain height by the clearance above ground, of one beam or several
gradiometer     components of the gravity gradient tensor, its tilt and its drift
"""
