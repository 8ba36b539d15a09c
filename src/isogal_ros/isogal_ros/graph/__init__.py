"""The whole graph: run, watched, replayed, evaluated.

domain         in which ROS domain?
shared_memory  which files of Fast DDS are left behind?
plan           which nodes, with which parameters, and how did it end?
parameter_files  what do a parameter file and options say to each node?
checks         what is checked before the first node starts?
progress       how far is it?
in_process     how does it run in one process?
processes      how does it run as one process for each node?
launching      what does the launch file do with its arguments?
bus            how do nodes hear each other without middleware?
recorded       what does a replay need of a bag?
player         how is it played to fresh nodes?
replay         how do their fixes differ from the recorded ones, and what was used?
parameter_reference  which parameters have all nodes? (docs/parameters.md)
session        what are the steps of a run and of a replay, from input to report?
watching       what has been recorded of a run that goes on?
live_page      how is it served to a browser?
dashboard      how is it shown in a terminal?
console        what is the user told?
commands       what do ``isogal run`` and ``isogal replay`` print and return?"""
