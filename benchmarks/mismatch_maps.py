"""The maps of `mismatch.py`: a coarser one, without and with what is known of its error."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

import numpy as np

from isogal.maps.field_map import FieldMap
from isogal.maps.formats.netcdf_writing import write_netcdf
from isogal.maps.load import load_map
from isogal.scenario import load_scenario
from isogal.sensors.trajectory import build_trajectory

COARSER = 2
"""Cells of the map to a cell of the coarse one."""
AROUND = 3.0
"""Its cells over which what it leaves out is averaged (1-sigma of a Gaussian weight)."""


@dataclass(frozen=True)
class Maps:
    """Map files, and how the coarse one differs from the fine one."""

    fine: str
    coarse: str
    rated: str
    """The coarse one with its 1-sigma at each node."""
    magnetic: str
    residual: float
    """1-sigma, m/s²."""
    length: float
    """m."""

    def put_in(self, settings: Sequence[str]) -> list[str]:
        """Return settings with names and numbers in place of what stands for them."""
        return [text.format(**vars(self)) for text in settings]


def coarse_map(data: Path, out: Path) -> Maps:
    """Write the map of a coarser grid, gravity and disturbance, without and with what is known of
    its error; return all maps."""
    fine, coarse, rated = data / "se_australia_gravity.nc", out / "coarse.nc", out / "rated.nc"
    out.mkdir(parents=True, exist_ok=True)
    route, difference = build_trajectory(load_scenario()), np.zeros(0)
    for quantity in ("disturbance", "gravity"):
        field_map = load_map(fine, quantity=quantity)
        wide, local = _coarser(field_map)
        mode = "a" if quantity == "gravity" else "w"
        _write(wide, coarse, mode)
        _write(replace(wide, sigma=local), rated, mode)
        difference = field_map.value(route.latitude, route.longitude) - wide.value(
            route.latitude, route.longitude
        )
    sigma = float(np.sqrt(np.nanmean(difference**2)))
    products = [np.nanmean(difference[: -lag or None] * difference[lag:]) for lag in range(600)]
    far = int(np.argmax(np.array(products) < products[0] / np.e))
    speed = float(np.hypot(*route.velocity[0, :2]))
    magnetic = data / "kalgoorlie_gravity_magnetic.nc"
    return Maps(str(fine), str(coarse), str(rated), str(magnetic), sigma, far * speed * route.dt)


def _coarser(field_map: FieldMap) -> tuple[FieldMap, np.ndarray]:
    """Return a map of means over cells, and the 1-sigma of what it leaves out at its nodes."""
    from scipy.ndimage import gaussian_filter

    rows, columns = (n // COARSER * COARSER for n in field_map.values.shape)

    def mean(axis: np.ndarray, count: int) -> np.ndarray:
        return axis[:count].reshape(-1, COARSER).mean(axis=1)

    blocks = field_map.values[:rows, :columns].reshape(
        rows // COARSER, COARSER, columns // COARSER, COARSER
    )
    wide = replace(
        field_map,
        latitude=mean(field_map.latitude, rows),
        longitude=mean(field_map.longitude, columns),
        values=blocks.mean(axis=(1, 3)),
        provenance=f"{field_map.provenance}, means of {COARSER} x {COARSER} cells",
    )
    apart = field_map.values - wide.value(*np.meshgrid(
        field_map.latitude, field_map.longitude, indexing="ij"
    ))  # fmt: skip
    squared = np.nan_to_num(apart[:rows, :columns] ** 2).reshape(blocks.shape).mean(axis=(1, 3))
    return wide, np.sqrt(gaussian_filter(squared, AROUND)) + 1e-7


def _write(field_map: FieldMap, path: Path, mode: Literal["a", "w"]) -> None:
    """Write a map to a file, beside what is in there or not."""
    import xarray as xr  # imports pandas, which takes a second

    with TemporaryDirectory() as folder:
        write_netcdf(field_map, Path(folder) / "one.nc")
        with xr.open_dataset(Path(folder) / "one.nc") as one:
            one.to_netcdf(path, mode=mode)
