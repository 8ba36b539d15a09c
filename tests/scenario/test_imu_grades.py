"""Grades of inertial sensors, a user's own, and what is given beside a grade."""

import pytest

from isogal.errors import InputError
from isogal.scenario import Imu, load_scenario, validate_scenario
from isogal.scenario.inertial import PAPER_GRADES, built_in

OWN = """\
mine:
  source: data sheet of my IMU, rev. 3
  accelerometer: {bias: 1mg, bias_instability: 20ug, random_walk: 60ug/rt-Hz}
  gyroscope: {bias: [1deg/h, 1deg/h, 3deg/h], g_sensitivity: 0.1deg/h/g}
tactical:
  gyroscope: {bias: 7deg/h}
"""
DEG_PER_HOUR = 4.84813681109536e-06


@pytest.fixture
def own(tmp_path):
    path = tmp_path / "grades.yaml"
    path.write_text(OWN)
    return str(path)


def test_every_grade_has_a_source_and_noise():
    assert list(built_in())[:3] == list(PAPER_GRADES)
    for name, grade in built_in().items():
        sensors = Imu(grade=name).sensors
        assert grade.source
        assert min(*sensors.accelerometer.random_walk, *sensors.gyroscope.random_walk) > 0.0
    assert Imu(grade="tactical").sensors.gyroscope.bias[0] == pytest.approx(DEG_PER_HOUR)


def test_what_is_given_replaces_what_the_grade_says():
    told = Imu(grade="tactical", accelerometer={"bias": 0.0, "scale_factor": "1ppm"}).sensors
    grade = Imu(grade="tactical").sensors
    assert told.accelerometer.bias == (0.0,) * 3
    assert told.accelerometer.scale_factor == (1e-6,) * 3
    assert told.accelerometer.random_walk == grade.accelerometer.random_walk
    assert told.gyroscope == grade.gyroscope


def test_a_users_own_grade_also_of_a_name_that_there_is(own):
    it = load_scenario(None, [f"imu.grades={own}", "imu.grade=mine"])
    assert it.imu.sensors.gyroscope.bias[2] == pytest.approx(3.0 * DEG_PER_HOUR)
    assert it.imu.sensors.accelerometer.bias_time == (1000.0,) * 3
    assert it.imu.sensors.accelerometer.scale_factor == (0.0,) * 3
    assert validate_scenario(it.model_dump(mode="json")) == it
    sensors = Imu(grade="tactical", grades=own).sensors
    assert sensors.gyroscope.bias[0] == pytest.approx(7.0 * DEG_PER_HOUR)
    assert sensors.accelerometer.bias == (0.0,) * 3


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("mine: {gyroscope: {bias: 5ug}}", "mine: gyroscope.bias: 'ug' is not a unit"),
        ("mine: {gyroscope: {drift: 1}}", "mine: unknown key 'gyroscope.drift'"),
        ("- mine", "must map names of grades"),
        ("mine: {", "not valid YAML (line "),
        ("mine: 3", "mine: "),
    ],
)
def test_a_bad_file_gives_one_line(tmp_path, text, says):
    path = tmp_path / "grades.yaml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        load_scenario(None, [f"imu.grades={path}", "imu.grade=mine"])
    assert says in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
