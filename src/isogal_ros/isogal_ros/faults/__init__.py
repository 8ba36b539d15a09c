"""The fault campaign: what the navigator does with sensors, messages, nodes and processes that
fail.

catalogue   which faults are there, and what does each do?
trials      a run without fault, and with one fault in it, in this process or in several
campaign    many trials, one after the other, and whether what became of the navigator was right"""
