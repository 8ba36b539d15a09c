"""Maps and readings that were measured, not simulated, and how well the readings are matched.

lines          readings along lines, and the maps that they are matched against
matches        matches of lines: error, 1-sigma, NEES; normalised innovations
clear_lake     the study at Clear Lake: gravity stations
scotland       the study over Scotland: aeromagnetic lines
untold         lines with nothing told, and on maps made of the surveys
kept           lines kept from maps of every set
reference      the reference of rigid tracks
tables         the tables of docs/evidence/real-data.md
"""
