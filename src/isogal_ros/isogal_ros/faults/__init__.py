"""The fault campaign: what the navigator does with sensors, messages, nodes and processes that
fail.

catalogue   which faults are there, and what does each do?
campaign    runs without fault, and with one fault in it, and whether what became of the
            navigator was right"""
