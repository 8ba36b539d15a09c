"""Sections about the map, how the truth differs from it, and the gravity that follows from it."""

from typing import Literal

from pydantic import Field, model_validator

from isogal.scenario.section import NonNegative, Positive, Section


class Map(Section):
    """Where the map comes from."""

    source: str = "synthetic"
    """'synthetic', or a file, or a GGMplus folder"""
    path: str | None = None
    """file or folder, where source names a format instead of a file"""
    variable: str | None = None
    """variable in the file, for example ga or dg; null = by quantity"""
    continuation: Literal["auto", "none"] = "auto"
    """auto: continued from where its values hold to route.height; none: taken as it is (but for
    field: gradient)"""
    level: float | None = Field(None, allow_inf_nan=False)
    """height at which its values hold, m, counted as route.height is; null = as the map says, else
    0"""
    terrain: str | None = None
    """map of the ground's height (a file, a GGMplus folder or 'synthetic'), if the values hold on
    the ground; route.height then counts from its zero"""
    downward_cutoff: Positive | None = None
    """shortest wavelength that is continued downwards, m; null = 2 pi times the way, at least two
    cells"""
    margin: Positive | None = 25_000.0
    """m of map kept around the route, as far as the map reaches: how far off it the vehicle goes;
    null = all of the map, wherever the route is: of a vehicle that has none"""

    @model_validator(mode="after")
    def _one_surface(self) -> "Map":
        if self.level is not None and self.terrain is not None:
            raise ValueError("values hold on a level or on terrain: give one of the two")
        return self


class MapError(Section):
    """How the simulated truth differs from the map: a field with covariance sigma² exp(-d / L) at
    distance d, Gaussian or of heavier tails, and a plane."""

    sigma: NonNegative = 0.0
    """m/s² (field: magnetic nT, terrain m, gradient 1/s²)"""
    correlation_length: Positive = 4000.0
    """L, m"""
    tails: float | None = Field(None, gt=2.0, allow_inf_nan=False)
    """degrees of freedom of Student's t distribution, which the error has at each place then, of
    1-sigma sigma: with 3, 1 % of the places have a third of its square; null = Gaussian"""
    offset: NonNegative = 0.0
    """1-sigma of a constant error of the whole map, unit of sigma"""
    tilt: NonNegative = 0.0
    """1-sigma of the slope to north and to east of an error of the whole map, unit of sigma per m;
    zero at the route's start"""


class Gravity(Section):
    """The gravity vector that the inertial sensors feel, and what the strapdown knows of it."""

    field: Literal["normal", "map"] = "map"
    """gravity that the vehicle feels: normal gravity, or also the map's vector"""
    compensation: Literal["none", "map"] = "map"
    """horizontal gravity that the strapdown takes off at its own position"""
    compensated_share: float = Field(1.0, ge=0.0, le=1.0)
    """share of it that is taken off, for studies"""
    residual_sigma: NonNegative | Literal["auto"] = "auto"
    """1-sigma of each horizontal component that is left, m/s², or auto"""
    residual_correlation_length: Positive | Literal["auto"] = "auto"
    """its correlation length along the track, m, or auto"""
