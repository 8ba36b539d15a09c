"""The whole graph: run, watched, replayed, evaluated.

domain         in which ROS domain?
plan           which nodes, with which parameters, and can they be used?
parameter_files  what do a parameter file and options say to each node?
running        how does it run, in one process or as one for each node?
forkserver     how is the process of a node started?
preloaded      what has it from the start?
launching      what does the launch file do with its arguments?
bus            how do nodes of one process hear each other past the middleware?
player         what does a replay need of a bag, and how is it played to fresh nodes?
replay         how do their fixes differ from the recorded ones, and what was used?
watching       how is a run shown that goes on?
commands       what do ``isogal run``, ``isogal replay`` and ``isogal faults`` print and return?
parameter_reference  which parameters have all nodes? (docs/parameters.md, the bringup file)"""
