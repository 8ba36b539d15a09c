"""What the nodes of the graph are made of.

base                what does every node have?
settings            which parameters has every node?
publishing          who has to listen, and what becomes of what cannot be published?
heartbeat           what does a node do once a second?
checkpoint          what does a node go on from when it is started again?
health              what does a node report of itself on /diagnostics?
nav_queue           what was the navigator's state of a stamp, and which readings wait for it?
listening           how are drivers heard that may lose messages, and which of several?
stuck               may a stamp, or a value that should have noise, be?
signals             how does a process end when it is asked to?
spin                how is a node run until its end?"""
