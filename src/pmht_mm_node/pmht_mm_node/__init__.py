"""Gravity map matching: batches of reduced readings to position fixes.

node      subscriptions: reduced readings, the navigator's states
scans     scans in order of time
warm_up   one batch before the first
survival  what a restarted node goes on from
outputs   messages on pmht_mm/*
"""

from isogal.threads import one_thread

one_thread()  # before the node imports NumPy
