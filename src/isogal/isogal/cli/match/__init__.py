"""``isogal match``: a recorded track of any scalar field against a map.

- `command`: the command, from the options to the results.
- `track_choice`: what can be said about the track?
- `options`: what can be said about matcher, errors and results?
- `inputs`: the track and the map, in one unit.
- `gradients`: the same of a gradiometer, in E.
- `other_fields`: which fields beside the first?
- `sigmas`: sigmas with units, and those that cannot be meant.
- `settings`: what the matcher is told.
- `run`: one track, from what was read to its report.
- `table`: the fixes as text.
"""
