"""Gravity map matching: batches of reduced readings to position fixes.

node      subscriptions: reduced readings, the navigator's states
scans     scans in order of time
warm_up   one batch before the first
verdict   what batches say, one after the other
restart   what a restarted node goes on from
outputs   messages on pmht_mm/*
"""

from isogal.threads import one_thread
from isogal_ros.nodes.signals import end_quietly

one_thread()  # before the node imports NumPy
end_quietly(__name__)
