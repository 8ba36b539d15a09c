"""Scenarios: the defaults that users rely on, files and overrides, one clear line for each kind of
bad input."""

import re

import pytest

from isogal.errors import InputError
from isogal.scenario import (
    Scenario,
    changed_scenario,
    known_keys,
    load_scenario,
    validate_scenario,
)

DEFAULTS = """
seed: 0
route: {start: [-38.0, 144.5], end: [-35.0, 150.0], speed: 22.0, height: 100.0, duration: 12960.0}
imu: {grade: precision, rate: 1.0}
initial_error: {position: 50.0, velocity: 0.05, tilt: 2.5e-5, heading: 3.0e-4}
gravimeter: {quantity: gravity, sigma: 1.0e-5, interval: 10.0}
map: {source: synthetic, path: null, variable: null}
map_error: {sigma: 0.0, correlation_length: 4000.0}
matcher: {name: pmht, batch_length: 30, stride: null, mode: standard, map_sigma: auto,
  map_correlation_length: 4000.0, bias_sigma: 0.0}
"""


def test_defaults(tmp_path):
    """What is the default is, written in a file, the default, and every key of it is checked."""
    it = load_scenario()
    assert it == Scenario()
    for text in (DEFAULTS, "# nothing\n"):
        (tmp_path / "s.yaml").write_text(text)
        assert load_scenario(tmp_path / "s.yaml") == it
    assert it.steps_per_scan == 10
    assert it.matcher.scans_between_fixes == 5


def test_file_and_overrides(tmp_path):
    path = tmp_path / "s.yaml"
    path.write_text("seed: 3\nroute: {height: 250}\nmatcher: {name: pmht-paper, batch_length: 20}")
    overrides = "matcher.batch_length=15", "map.source=1e5_tiles.nc", "route.duration=null"
    it = load_scenario(path, overrides)
    assert (it.seed, it.route.height, it.matcher.name) == (3, 250.0, "pmht-paper")
    assert (it.matcher.batch_length, it.map.source) == (15, "1e5_tiles.nc")
    assert it.route.duration is None


@pytest.mark.parametrize(
    ("text", "value"),
    [("1e-5", 1e-5), (".5e-4", 5e-5), ("+1E-4", 1e-4)],
)
def test_exponents_without_a_dot_are_numbers(tmp_path, text, value):
    """YAML 1.1 reads 1e-5 as a string."""
    path = tmp_path / "s.yaml"
    path.write_text(f"gravimeter: {{sigma: {text}}}\n")
    assert load_scenario(path).gravimeter.sigma == value
    assert load_scenario(None, f"gravimeter.sigma={text}").gravimeter.sigma == value


def test_waypoints_take_the_place_of_both_ends():
    waypoints = "route.waypoints=[[-38, 144.5, 2e1], [-37, 146, 30]]"
    it = load_scenario(None, [waypoints, "route.start=null", "route.end=null"])
    assert it.route.waypoints == ((-38.0, 144.5, 20.0), (-37.0, 146.0, 30.0))


@pytest.mark.parametrize(
    ("override", "message"),
    [
        (
            "matcher.batch_lenght=15",
            "unknown key 'matcher.batch_lenght', did you mean 'matcher.batch_length'?",
        ),
        ("batch_length=15", "unknown key 'batch_length', did you mean 'matcher.batch_length'?"),
        ("xyz=1", "unknown key 'xyz'; allowed: seed, field, route, imu, "),
        ("route={speed: 1,5}", "unknown key 'route.5'; allowed: route.start"),
        ("gravimeter.sigma=-1", "gravimeter.sigma: must be greater than 0, not -1"),
        ("gnss.lever_arm=[.nan, 0, 0]", "gnss.lever_arm.0: must be a finite number, not nan"),
        (
            "gravimeter.interval=10.5",
            "gravimeter.interval (10.5 s) must be a whole number of IMU samples (1/1.0 s)",
        ),
        (
            "gravimeter.quantity=magnetic",
            "gravimeter.quantity: must be 'gravity' or 'disturbance', not 'magnetic'",
        ),
        (
            "imu.grade=best",
            "imu.grade: 'best' is not known; allowed: precision, quantum_accelerometer, quantum,"
            " navigation, ",
        ),
        (
            "matcher.name=magic",
            "matcher.name: unknown matcher 'magic'; allowed: iccp, particle, pmht, pmht-paper,"
            " point-mass, sitan, tercom, viterbi",
        ),
        (
            "field=magnetik",
            "field: unknown field 'magnetik' (did you mean 'magnetic'?); allowed: disturbance, ",
        ),
        ("matcher.stride=31", "matcher: stride (31) must not exceed batch_length (30)"),
        ("route.start=[95, 0]", "route.start.0: must be at most 89.9, not 95"),
        ("route.start=null", "route: give start and end, or waypoints"),
        ("route.waypoints=[[-38, 144, 22]]", "route: waypoints needs at least two points"),
        ("route=null", "route: must be a section of keys, not null"),
        ("seed=2020-01-02", "seed: must be a whole number, not 2020-01-02"),
        ("matcher.map_sigma=true", "matcher.map_sigma: must be a number or 'auto', not true"),
        ("imu.accelerometer.bias=[1, 2, yes]", "imu.accelerometer.bias: must be a number"),
        ("gnss.available=[[9, 5]]", "gnss.available: must be [[from, to], ...], s since the"),
        (
            "gnss.deception={start: 300, end: 200}",
            "gnss.deception: end (200 s) must be after start (300 s)",
        ),
        (
            "gnss.deception.kind=walk",
            "gnss: deception.kind (walk): there is no receiver to deceive; give available, or",
        ),
    ],
)
def test_bad_values_give_one_line_that_names_the_key(override, message):
    with pytest.raises(InputError) as caught:
        load_scenario(None, [override])
    text = str(caught.value)
    assert text.startswith(f"scenario: {message}"), text
    assert "\n" not in text
    assert "pydantic" not in text


@pytest.mark.parametrize("text", ["abc", ".nan", "null", "[[a]]", "{a: 1}", "true", "[no, 1, 2]"])
def test_no_key_is_refused_in_the_words_of_a_library(text):
    """And no number is true or false."""
    refused = []
    for key in known_keys(Scenario):
        try:
            found = load_scenario(None, [f"{key}={text}"])
        except InputError as error:
            refused.append(str(error))
            continue
        for name in key.split("."):
            found = getattr(found, name)
        assert found is True or text not in ("true", "[no, 1, 2]"), key
    assert len(refused) > 10
    foreign = re.compile("input should|extra inputs|value_error|valid|otherwise|instance", re.I)
    assert not [line for line in refused if foreign.search(line)]


def test_times_of_aids_after_the_end_and_runs_too_short_for_a_fix_are_said():
    keys = "gnss.available=[[0, 50], [60, 70]]", "positions=[{available: [[80, 90]]}]"
    keys += ("matcher.batch_length=6",)
    scenario = load_scenario(None, keys)
    assert scenario.never_available(100.0) == []
    assert scenario.never_available(60.0) == [
        "gnss.available: [60, 70] is after the end of the run, 60 s",
        "positions.0.available: [80, 90] is after the end of the run, 60 s",
    ]
    assert load_scenario().never_available(299.0) == [
        "matcher.batch_length: 30 readings, one each 10 s, take longer than the run, 299 s:"
        " it has no fix"
    ]


def test_several_mistakes_are_all_named():
    with pytest.raises(InputError, match=r"seed: .*; route\.speed: .*; unknown key 'extra'"):
        load_scenario(None, ["seed=-1", "route.speed=0", "extra=1"])


@pytest.mark.parametrize(("text", "message"), [
    ("route: [1, 2\n", r"s\.yaml: not valid YAML \(line \d\): "),
    ("just words\n", r"s\.yaml: must be a mapping of keys, is a str"),
    ("seed: {\xff}\n".encode("latin-1"), r"s\.yaml: is not a text file"),
    ("sead: 1\n", r"s\.yaml: unknown key 'sead', did you mean 'seed'\?"),
    (None, r"cannot be read: No such file"),
])  # fmt: skip
def test_bad_files_give_one_line_that_names_the_file(tmp_path, text, message):
    path = tmp_path / "s.yaml"
    if text is not None:
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(InputError, match=message) as caught:
        load_scenario(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("override", "message"), [
    ("seed", "--set seed: must be KEY=VALUE, for example"),
    ("=5", "--set =5: must be KEY=VALUE"),
    ("seed=[1", "--set seed=[1: the value is not valid YAML"),
    ("seed.x=1", "scenario: seed: must be a whole number"),
])  # fmt: skip
def test_bad_overrides(override, message):
    with pytest.raises(InputError) as caught:
        load_scenario(None, [override])
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


def test_known_keys_and_round_trip():
    keys = known_keys(Scenario)
    for key in ("seed", "route.waypoints", "imu.grade", "matcher.map_sigma", "map_error.sigma"):
        assert key in keys
    it = load_scenario(None, ["matcher.stride=5", "route.waypoints=[[0, 0, 5], [1, 1, 6]]"])
    assert validate_scenario(it.model_dump(mode="json")) == it
    assert it.matcher.scans_between_fixes == 5


def test_a_scenario_is_changed_key_by_key():
    first = load_scenario(None, ["route.speed=30", "matcher.name=tercom"])
    other = changed_scenario(first, ["matcher.name=pmht", "route.duration=600"], "bag: scenario")
    assert (other.route.speed, other.route.duration, other.matcher.name) == (30.0, 600.0, "pmht")
    assert first.matcher.name == "tercom"
    with pytest.raises(InputError, match=r"^bag: scenario: unknown key 'rute'"):
        changed_scenario(first, ["rute.speed=3"], "bag: scenario")
