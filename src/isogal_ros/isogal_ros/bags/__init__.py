"""Recordings (MCAP, as ``ros2 bag`` writes them).

recorder     which node records the graph?
writer       how is a bag written?
metadata     what does its metadata.yaml say?
reader       how is a bag read, whole or cut off?
record       which messages does the record of a run need, and how do they become it?
viewing      what does `isogal view` show of a bag?"""

from isogal_ros.nodes.signals import end_quietly

end_quietly("isogal_recorder", "isogal_ros.bags.recorder")
