"""Gravity map matching: batches of reduced readings to position fixes.

node      subscriptions: reduced readings, the navigator's states; restarts
scans     scans in order of time
verdict   what batches say, one after the other
outputs   messages on pmht_mm/*
"""

from isogal.threads import one_thread
from isogal_ros.nodes.signals import end_quietly

one_thread()  # before the node imports NumPy
end_quietly(__name__)
