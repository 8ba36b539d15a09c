"""The fields that can be measured and matched, and the maps that a scenario needs of them.

    measured         what a field is; fields by name (entry points `isogal.fields`)
    simulator        simulated readings: truth from the map, map error, noise
    magnetic_vehicle  what a magnetic vehicle adds, and what is assumed of it
    beams            soundings of an altimeter with several beams
    map_error        samples of how far the true field differs from its map
    scenario_map     the map of what a scenario measures
    source_map       the map that a scenario names, and at the height of the flight
    derived_maps     maps of several channels, computed from that map
    gravity_vector   the gravity vector around a route, and what the vehicle senses of it
    known_gravity    what a navigator knows of horizontal gravity
    simulated_vehicle  one run: route, inertial sensors, unaided INS

The fields:

    gravity          gravity and gravity disturbance
    magnetic         magnetic anomaly
    terrain          height of the terrain
    gradient         components of the gravity gradient tensor
"""
