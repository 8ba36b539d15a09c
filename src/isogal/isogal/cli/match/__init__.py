"""``isogal match``: a recorded track of any scalar field against a map.

- `command`: the command, from the options to the results.
- `options`: what can be said about track, matcher, errors and results?
- `inputs`: the track and the map, in one unit.
- `settings`: what the matcher is told.
- `table`: the fixes as text.
"""
