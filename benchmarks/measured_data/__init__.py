"""Maps and readings that were measured, not simulated, and how well the readings are matched.

lines          readings along lines, and the maps that they are matched against
matches        figures of matches: error, 1-sigma, NEES
untold         lines on the maps that come with them, nothing told
kept           lines kept from maps of every set by `isogal map grid`
reference      the reference of rigid tracks
"""
