"""The fault campaign: what the navigator does with sensors and processes that fail.

catalogue  which faults are there, and what do they do to a message?
trial      what became of the navigator under one fault?
process_faults, process_trial   the same of faults of processes
campaign   many of them, one after the other, and their table"""
