"""Simulated gravimeter and its reductions with the navigator's estimate."""

from isogal.threads import one_thread
from isogal_ros.nodes.signals import end_quietly

one_thread()  # before the node imports NumPy
end_quietly(__name__)
