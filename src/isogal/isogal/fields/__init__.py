"""The fields that can be measured and matched, and the maps that a scenario needs of them.

    measured         what a field is; fields by name (entry points `isogal.fields`)
    simulator        simulated readings: truth from the map, map error, noise
    datum_error      a map's wrong datum: offset and tilt
    scenario_map     the map of what a scenario measures
    source_map       the map that a scenario names
    flown_height     that map at the height of the flight
    derived_maps     maps of several channels, computed from that map

The fields:

    gravity          gravity and gravity disturbance
    magnetic         magnetic anomaly
    terrain          height of the terrain
    gradient         components of the gravity gradient tensor
"""
