"""The scenario: one YAML document, validated, that says everything about a run.

Keys, units and defaults are a public contract. An unknown key is an error that names the nearest
one.

section      what do the sections share: strictness, ranges of numbers?
vehicle      which keys describe the route, the inertial sensors and the initial errors?
instruments  which keys describe the gravimeter, magnetometer, altimeter and gradiometer?
world        which keys describe the map and its error?
matcher      which keys describe the map matcher?
truth        where do the true values differ from those that are assumed?
fusion       which keys describe the navigator's filter?
model        which sections has a scenario?
loading      how is a file read, and how are single keys overridden?
messages     how does a validation error become one line?"""

from isogal.scenario.fusion import Fusion
from isogal.scenario.instruments import (
    TENSOR_COMPONENTS,
    Altimeter,
    Gradiometer,
    Gravimeter,
    Magnetometer,
)
from isogal.scenario.loading import load_scenario, validate_scenario
from isogal.scenario.matcher import Matcher
from isogal.scenario.messages import describe, known_keys
from isogal.scenario.model import Scenario
from isogal.scenario.truth import truth_of
from isogal.scenario.vehicle import Imu, InitialError, Route
from isogal.scenario.world import Map, MapError

__all__ = [
    "TENSOR_COMPONENTS",
    "Altimeter",
    "Fusion",
    "Gradiometer",
    "Gravimeter",
    "Imu",
    "InitialError",
    "Magnetometer",
    "Map",
    "MapError",
    "Matcher",
    "Route",
    "Scenario",
    "describe",
    "known_keys",
    "load_scenario",
    "truth_of",
    "validate_scenario",
]
