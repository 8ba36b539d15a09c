"""Other fields that were read along the track of ``isogal match`` (`--also`)."""

import math
from dataclasses import dataclass, replace

from isogal.cli.map_choice import MapChoice
from isogal.cli.match.gradients import read_gradients
from isogal.cli.match.inputs import Inputs, read_inputs
from isogal.cli.match.options import Assumptions
from isogal.cli.match.track_choice import TrackChoice
from isogal.errors import InputError

_REQUIRED = ("map", "column")
KEYS = (
    *_REQUIRED,
    *("variable", "quantity", "unit", "crs", "format"),
    *("track-unit", "reduction", "height", "map-height"),
    *("sensor-sigma", "map-sigma", "map-correlation-length", "bias-sigma"),
)
"""Of `--also`."""


@dataclass(frozen=True)
class FieldChoice:
    """One field: its map, its readings, and what is assumed of their errors."""

    name: str
    map_: MapChoice
    track: TrackChoice
    assumed: Assumptions

    def read(self) -> list[Inputs]:
        """Return the field's readings and map, of each line of the file; raises InputError."""
        if self.track.gradients is not None:
            return read_gradients(self.map_, self.track, self.assumed)
        return read_inputs(self.map_, self.track, self.assumed)


def all_fields(map_: MapChoice, track: TrackChoice, assumed: Assumptions) -> list[FieldChoice]:
    """Return the field of the options themselves and those of `--also`.

    Raises
    ------
    InputError
        `--also` is not understood, or says what does not go together.
    """
    name = "gradients" if track.gradients is not None else (track.column or "value")
    first = FieldChoice(name, map_, replace(track, also=None), assumed)
    return [first, *(_field(text, first) for text in track.also or ())]


def _field(text: str, first: FieldChoice) -> FieldChoice:
    from isogal.tracks.recording import is_recording

    said = _keys(text)
    if is_recording(first.track.track):
        raise InputError(f"--also: goes with a text file, not with a bag ({first.track.track})")
    map_ = MapChoice(
        source=said["map"],
        variable=said.get("variable"),
        quantity=said.get("quantity"),
        unit=said.get("unit"),
        crs=said.get("crs"),
        format_name=said.get("format"),
    )
    track = TrackChoice(
        track=first.track.track,
        column=said["column"],
        spacing=first.track.spacing,
        track_unit=said.get("track-unit"),
        reduction=said.get("reduction"),
        height=_number(said, "height"),
        map_height=_number(said, "map-height"),
    )
    assumed = Assumptions(
        prior_sigma=first.assumed.prior_sigma,
        sensor_sigma=said.get("sensor-sigma"),
        map_sigma=said.get("map-sigma"),
        map_correlation_length=_number(said, "map-correlation-length"),
        bias_sigma=said.get("bias-sigma"),
    )
    return FieldChoice(said["column"], map_, track.resolved(), assumed)


def _keys(text: str) -> dict[str, str]:
    """Return the keys and values of ``KEY=VALUE,...``; raises InputError."""
    said: dict[str, str] = {}
    for part in text.split(","):
        key, sign, value = part.partition("=")
        key, value = key.strip(), value.strip()
        if not sign or not value:
            raise InputError(f"--also {text}: '{part}' is not KEY=VALUE")
        if key not in KEYS:
            raise InputError(f"--also {text}: unknown key '{key}'; known: {', '.join(KEYS)}")
        if key in said:
            raise InputError(f"--also {text}: {key} is given twice")
        said[key] = value
    missing = [key for key in _REQUIRED if key not in said]
    if missing:
        raise InputError(f"--also {text}: {' and '.join(missing)} must be given")
    return said


def _number(said: dict[str, str], key: str) -> float | None:
    if key not in said:
        return None
    try:
        number = float(said[key])
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise InputError(f"--also: {key} must be a number, is '{said[key]}'")
    return number
