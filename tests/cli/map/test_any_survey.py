"""`isogal map grid` of any survey: a map, or one line; never a traceback."""

import json

import numpy as np
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from helpers.command_line import call
from helpers.surveys import few_places

__all__ = ["few_places"]

SHAPES = {
    "one line": lambda t: (3e3 * t, 4e3 * t),
    "two lines crossing": lambda t: np.where(
        t < 0.5, (8e3 * t, 2e3 + 0 * t), (2e3 + 0 * t, 8e3 * (t - 0.5))
    ),
    "loop": lambda t: (2e3 * np.sin(20.0 * t), 2e3 * np.cos(20.0 * t)),
    "repeated": lambda t: (2e3 * np.sin(np.floor(6.0 * t)), 2e3 * np.cos(np.floor(6.0 * t))),
    "standing": lambda t: (0.0 * t, 0.0 * t),
    "gap": lambda t: (3e3 * np.sin(9.0 * t), 2e3 * np.cos(31.0 * t) + 3e4 * (t > 0.5)),
}
READINGS = {
    "true": lambda x, y, t: 10.0 * np.sin(x / 800.0) + 8.0 * np.cos(y / 1100.0),
    "constant": lambda x, y, t: 0.0 * t + 3.0,
    "huge": lambda x, y, t: 0.0 * t + 1e6,
    "one huge": lambda x, y, t: np.where(t == t[t.size // 2], 3e4, np.sin(x / 800.0)),
    "none": lambda x, y, t: np.where(t > 0.1, np.nan, np.sin(x / 800.0)),
}


def write_survey(path, shape, count, readings, lines):
    t = np.arange(count) / count
    north, east = SHAPES[shape](t)
    value = READINGS[readings](north, east, t)
    number = np.floor(lines * t).astype(int)
    rows = [
        f"{-36.5 + x / 111e3:.7f},{147.0 + y / 89.5e3:.7f},{k},{'' if np.isnan(v) else f'{v:.6g}'}"
        for x, y, k, v in zip(north, east, number, value, strict=True)
    ]
    path.write_text("\n".join(["latitude,longitude,line,mag[nT]", *rows]) + "\n")


@settings(max_examples=2, suppress_health_check=[HealthCheck.function_scoped_fixture])
@example("two lines crossing", 400, "true", 2, ("--level",))
@example("two lines crossing", 60, "constant", 2, ("--level",))
@example("gap", 5000, "true", 1, ())
@example("loop", 300, "one huge", 3, ())
@given(
    shape=st.sampled_from(sorted(SHAPES)),
    count=st.sampled_from([29, 61, 200]),
    readings=st.sampled_from(sorted(READINGS)),
    lines=st.sampled_from([1, 2, 7]),
    more=st.sampled_from([(), ("--level",), ("--leave-out", "blocks")]),
)
def test_any_survey_gives_a_map_or_one_line(tmp_path, shape, count, readings, lines, more):
    write_survey(tmp_path / "survey.csv", shape, count, readings, lines)
    out = tmp_path / "map.nc"
    out.unlink(missing_ok=True)
    said = ("--variable", "mag", "--quantity", "magnetic_anomaly", "--spacing", 500, "--json")
    status, printed, err = call("map", "grid", tmp_path / "survey.csv", out, *said, *more)
    assert "Traceback" not in err
    if status:
        assert (status, printed) == (2, "")
        assert err.startswith("isogal: ") and err.count("\n") == 1
        assert not out.exists()
    else:
        assert json.loads(printed)["survey"]["left_out"]["rms"] >= 0.0
        assert out.exists()
