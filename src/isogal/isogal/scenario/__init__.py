"""The scenario: one YAML document, validated, that says everything about a run.

Keys, units and defaults are a public contract. An unknown key is an error that names the nearest
one.

section      what do the sections share: strictness, validation in one line?
vehicle      which keys describe the route and the initial errors?
inertial     which keys describe the inertial sensors, and which grades of them are there?
data_sheet   how are the units of data sheets read?
instruments  which keys describe gravimeter, magnetometer, altimeter, gradiometer, and recordings?
aids         which keys describe sensors of height and velocity, and satellites?
map          which keys describe the map, its error and the gravity vector?
matcher      which keys describe the map matcher?
fields       how does a scenario have several fields?
truth        where do the true values differ from those that are assumed?
navigator    which keys describe the solution of an INS, the filter, and the protection level?
model        which sections has a scenario, and what is assumed or true by it?
loading      how is a file read, and how are single keys overridden?"""

from isogal.scenario.aids import (
    AnyAid,
    Deception,
    Gnss,
    HeadingAid,
    Height,
    PositionAid,
    Velocity,
)
from isogal.scenario.inertial import Imu, ImuErrors, SensorErrors
from isogal.scenario.instruments import (
    TENSOR_COMPONENTS,
    Aircraft,
    Altimeter,
    Gradiometer,
    Gravimeter,
    Magnetometer,
    Readings,
)
from isogal.scenario.loading import changed_scenario, load_scenario, validate_scenario
from isogal.scenario.map import Gravity, Map, MapError
from isogal.scenario.matcher import Matcher
from isogal.scenario.model import Assumed, Scenario, Settings, Truth
from isogal.scenario.navigator import Fusion, Ins, Integrity
from isogal.scenario.section import known_keys, validated
from isogal.scenario.truth import truth_of
from isogal.scenario.vehicle import InitialError, Route

__all__ = [
    "TENSOR_COMPONENTS",
    "Aircraft",
    "Altimeter",
    "AnyAid",
    "Assumed",
    "Deception",
    "Fusion",
    "Gnss",
    "Gradiometer",
    "Gravimeter",
    "Gravity",
    "HeadingAid",
    "Height",
    "Imu",
    "ImuErrors",
    "InitialError",
    "Ins",
    "Integrity",
    "Magnetometer",
    "Map",
    "MapError",
    "Matcher",
    "PositionAid",
    "Readings",
    "Route",
    "Scenario",
    "SensorErrors",
    "Settings",
    "Truth",
    "Velocity",
    "changed_scenario",
    "known_keys",
    "load_scenario",
    "truth_of",
    "validate_scenario",
    "validated",
]
