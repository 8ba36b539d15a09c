"""The command line. A command imports what it computes with when it is called.

Commands

- `run`: ``isogal run``, ``replay``, ``faults`` and ``smooth``, the graph of nodes.
- `montecarlo`: ``isogal montecarlo``, a scenario many times.
- `paper`: ``isogal paper``, the reproduction of the paper.
- `match`: ``isogal match``, a recorded track against a map.
- `view`: ``isogal view`` and ``isogal compare``, a run to look through, studies side by side.
- `plan`: ``isogal plan``, the route on which the navigator arrives with the least error.
- `mag`: ``isogal mag calibrate`` and ``compensate``, a magnetometer on a magnetic vehicle.
- `map`: ``isogal map info``, ``variability``, ``synth``, ``fetch``, ``convert``, ``grid``,
  ``continue`` and ``navigability``.

What they share

- `start`: where does the program start?
- `main`: the program ``isogal``; which commands are there?
- `errors`: how does a command end that cannot go on?
- `option_groups`: how do several options become one parameter of a command?
- `checks`: is a number allowed, can a file be written?
- `options`: scenario, workers, folder of results.
- `map_choice`: which map, and what is in the file?
- `progress`: how far is what takes time?
"""
