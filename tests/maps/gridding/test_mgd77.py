"""Track lines of ships in MGD77, as records in fixed columns and as a table."""

import numpy as np
import pytest

from helpers.refusals import refusal
from isogal.maps.gridding.reading import read_survey
from isogal.tracks.csv_file import read_csv_tracks

N = 60
LAT = -36.5 + 0.1 * np.sin(np.arange(N))
LON = -147.0 + 0.1 * np.cos(1.7 * np.arange(N))
ANOMALY = 10.0 * np.sin(0.4 * np.arange(N))
DEPTH = 4000.0 + 100.0 * np.cos(0.2 * np.arange(N))
TABLE_HEAD = (
    "SURVEY_ID\tTIMEZONE\tDATE\tTIME\tLAT\tLON\tPOS_TYPE\tNAV_QUALCO\tBAT_TTIME\tCORR_DEPTH\t"
    "BAT_CPCO\tBAT_TYPCO\tBAT_QUALCO\tMAG_TOT\tMAG_TOT2\tMAG_RES\tMAG_RESSEN\tMAG_DICORR\t"
    "MAG_SDEPTH\tMAG_QUALCO\tGRA_OBS\tEOTVOS\tFREEAIR\tGRA_QUALCO\tLINEID\tPOINTID"
)


def record(k, *, zone="-10", place=True, kind="5"):
    """A record of minute k of 31 December 1999 from 23:00 on, by the ship's clock; 120
    characters."""
    clock = f"{23 + k // 60:02d}{1000 * (k % 60) + 500:05d}"
    where = (
        f"{round(1e5 * LAT[k]):+08d}{round(1e5 * LON[k]):+09d}" if place else "+9999999+99999999"
    )
    free_air = f"{round(10 * ANOMALY[k]):+05d}" if k != 7 else "+9999"
    text = (
        f"{kind}SHIP0001{zone}19991231{clock}{where}1999999{round(10 * DEPTH[k]):06d}991"
        f"999999999999+999999+9999+999999999999+99999{free_air}SEISM   1239"
    )
    assert len(text) == 120
    return text


def row(k):
    cells = [""] * 26
    cells[:6] = ["S1", "-10", "19991231", f"{2300 + k + 0.5}", f"{LAT[k]:.5f}", f"{LON[k]:.5f}"]
    cells[9], cells[22] = f"{DEPTH[k]:.1f}", f"{ANOMALY[k]:.1f}" if k != 7 else ""
    return "\t".join(cells)


def written(path, lines):
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture(params=["fixed", "table"])
def ship(request, tmp_path):
    """A voyage of an hour, without the anomaly of one minute."""
    if request.param == "fixed":
        head = [f"4MGD77 header {k:02d}".ljust(80) for k in range(24)]
        return written(tmp_path / "a.mgd77", [*head, *map(record, range(N))])
    return written(tmp_path / "a.m77t", [TABLE_HEAD, *map(row, range(N))])


def test_as_a_survey(ship):
    survey = read_survey(ship)
    assert (survey.quantity, survey.file_unit, len(survey)) == ("gravity_anomaly", "mGal", N - 1)
    kept = np.arange(N) != 7
    np.testing.assert_allclose(survey.value, 1e-5 * ANOMALY[kept], atol=0.051e-5)
    np.testing.assert_allclose(np.degrees(survey.latitude), LAT[kept], atol=0.6e-5)
    np.testing.assert_allclose(np.degrees(survey.longitude), LON[kept], atol=0.6e-5)
    depths = read_survey(ship, "topography")
    assert (depths.quantity, len(depths)) == ("height", N)
    np.testing.assert_allclose(depths.value, -DEPTH, atol=0.051)


def test_as_a_track_with_times_in_utc(ship):
    (track,) = read_csv_tracks(ship, column="gravity_anomaly")
    start = np.datetime64("1999-12-31T13:00:30").astype("datetime64[s]").astype(float)
    np.testing.assert_allclose(track.time, start + 60.0 * np.arange(N), atol=1e-3)
    assert np.flatnonzero(np.isnan(track.value)).tolist() == [7]


def test_records_without_a_place_are_left_out(tmp_path):
    lines = [record(k, place=k != 3) for k in range(N)]
    assert len(read_survey(written(tmp_path / "a.a77", lines), "topography")) == N - 1


@pytest.mark.parametrize(
    "name,lines,words",
    [
        ("a.mgd77", ["4header"], "has no records of MGD77"),
        (
            "a.mgd77",
            [record(0), record(1)[:80]],
            "line 2 is no record of MGD77 since 1998: '5SHIP0001",
        ),
        ("a.mgd77", [record(0, kind="3")], "line 1 is no record of MGD77 since 1998"),
        ("a.mgd77", [record(0, place=False)], "has no records of MGD77"),
        ("a.m77t", [row(0), row(1)], "has no header of MGD77T"),
        ("a.m77t", [TABLE_HEAD, row(0), row(1)[:30]], "line 3 is no record of MGD77"),
        ("a.m77t", [TABLE_HEAD, row(0).replace("19991231", "19991331")], "line 2 is no record"),
    ],
)
def test_damaged_files_are_refused_in_one_line(tmp_path, name, lines, words):
    with refusal(words):
        read_survey(written(tmp_path / name, lines))
