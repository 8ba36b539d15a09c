"""What the nodes of the graph are made of.

base        what does every node have?
health      what does a node say about itself on /diagnostics?
nav_sample  what is a state of the navigator?
nav_buffer  what did the navigator say of a stamp, and how far did a fix move it?
nav_queue   which readings wait for the navigator's state of their stamp?
spin        how is a node run until its end?"""
