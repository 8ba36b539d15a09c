"""Unscented Kalman filter that fuses inertial data with map matching fixes.

node            subscriptions: IMU samples, fixes and the information that belongs to them
settings        the node's own parameters
start           the filter's first state
navigation      the filter from its start on: gaps, and what survives a restart
unresolved_gap  what is not known after a long gap
watch           what is wrong with IMU samples that could each be right
pose            a pose that a user gives
fixes           fixes applied to the filter, each once
measuring       what became of measurements, counted by topic
outputs         messages on nav/*
track           the way so far on nav/path
"""

from isogal.threads import one_thread
from isogal_ros.nodes.signals import end_quietly

one_thread()  # before the node imports NumPy
end_quietly(__name__)
