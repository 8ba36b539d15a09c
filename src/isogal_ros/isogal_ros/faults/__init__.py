"""The fault campaign: what the navigator does with sensors that fail.

catalogue  which faults are there, and what do they do to a message?
trial      what became of the navigator under one fault?
campaign   many of them, one after the other, and their table"""
