"""Unscented Kalman filter that fuses inertial data with map matching fixes.

node           subscriptions: IMU samples, fixes and the information that belongs to them
settings       the node's own parameters
beginning      the filter's first state: which of several, or one that a user gives
navigation     the filter from its start on, and what survives a restart
sample_checks  what is wrong with IMU samples that could each be right, and which are missing
solution       an INS in place of the samples
aids           sensors beside the IMU
fixes          fixes applied to the filter, each once
measuring      what became of measurements, counted by topic
outputs        messages on nav/*, and frames of the vehicle
"""

from isogal.threads import one_thread
from isogal_ros.nodes.signals import end_quietly

one_thread()  # before the node imports NumPy
end_quietly(__name__)
