"""The fault campaign: what the navigator does with sensors, messages, nodes and processes that
fail.

catalogue       which faults of messages are there, and what do they do to one?
node_faults     faults of nodes within one process
stage           the sensors of a run, and fresh nodes that they are played to
trial           a run with a fault in it
process_faults, process_trial   the same of faults of processes
outcome         what became of the navigator
campaign        many trials, one after the other
table           and their table"""
