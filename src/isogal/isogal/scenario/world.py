"""Sections about the map and about how the simulated truth differs from it."""

from pydantic import Field

from isogal.scenario.section import NonNegative, Positive, Section


class Map(Section):
    """Where the map comes from."""

    source: str = Field("synthetic", description="'synthetic', or a file, or a GGMplus folder")
    path: str | None = Field(
        None, description="file or folder, where source names a format instead of a file"
    )
    variable: str | None = Field(
        None, description="variable in the file, for example ga or dg; null = by quantity"
    )


class MapError(Section):
    """How the simulated truth differs from the map: a Gaussian field with covariance
    sigma² exp(-d / L) at distance d, and a plane."""

    sigma: NonNegative = Field(
        0.0, description="m/s² (field: magnetic nT, terrain m, gradient 1/s²)"
    )
    correlation_length: Positive = Field(4000.0, description="L, m")
    offset: NonNegative = Field(
        0.0, description="1-sigma of a constant error of the whole map, unit of sigma"
    )
    tilt: NonNegative = Field(
        0.0,
        description=(
            "1-sigma of the slope to north and to east of an error of the whole map, unit of sigma"
            " per m; zero at the route's start"
        ),
    )
