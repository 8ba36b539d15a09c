"""What the Isogal nodes share, and what starts, records and replays them.

topics      which topics has the graph, of which types, from whom to whom?
messages    how do messages become arrays, and the reverse?
parameters  which ROS parameters has a scenario?
nodes       what has every node: parameters, guarded subscriptions, diagnostics, its process?
bags        how are recordings written and read?
graph       how is the whole graph run, watched, replayed and evaluated?
faults      what do faulty sensors do to it?
security    who may publish and hear what?

Each knows those above it only."""
