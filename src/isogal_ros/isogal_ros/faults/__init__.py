"""The fault campaign: what the navigator does with sensors, messages, nodes and processes that
fail.

catalogue   which faults are there, and what does each do?
stage       a run without fault, and fresh nodes that its sensors are played to
trial       a run with one fault in it, in this process
processes   the same with a process for each node
judgement   what became of the navigator, and was that right? the table
campaign    many trials, one after the other"""
