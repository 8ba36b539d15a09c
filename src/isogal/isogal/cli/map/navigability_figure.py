"""The figure of navigability: expected error on the mean and the worst heading, the probability of
a second place, and the variability of the map."""

from typing import TYPE_CHECKING

import numpy as np

from isogal.earth.ellipsoid import metres_per_radian
from isogal.evaluation.figures import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from isogal.evaluation.navigability.area import Navigability


@style.journal
def navigability_figure(found: "Navigability") -> "Figure":
    """Draw four heat maps of an area."""
    north, east = metres_per_radian(float(found.latitude.mean()))
    shape = float(np.ptp(found.latitude) * north / (np.ptp(found.longitude) * east))
    figure = style.new_figure(min(max(2.0 * style.WIDTH * 0.42 * shape + 0.9, 3.0), 8.0))
    panels = figure.subplots(2, 2, sharex=True, sharey=True)
    names = ("error_mean", "error_worst", "ambiguity", "variability")
    titles = (
        "RMS error on arrival (m)",
        "on the worst heading (m)",
        "probability of a second place",
        "variability",
    )
    layers = found.layers()
    extent = [*np.degrees(found.longitude[[0, -1]]), *np.degrees(found.latitude[[0, -1]])]
    low = float(np.nanquantile(found.mean, 0.01))
    high = float(np.nanquantile(found.worst, 0.99))
    for panel, name, title in zip(panels.flat, names, titles, strict=True):
        grid, unit, _ = layers[name]
        if unit == "m/s²":
            grid, unit = grid / style.MGAL, "$10^{-5}$ m/s²"
        limits: dict[str, float] = (
            {"vmin": low, "vmax": high} if name.startswith("error") else {"vmin": 0.0}
        )
        if name == "ambiguity":
            limits["vmax"] = max(float(np.nanmax(grid)), 0.01)
        image = panel.imshow(
            grid,
            origin="lower",
            extent=extent,
            aspect=1.0 / np.cos(float(found.latitude.mean())),
            cmap="viridis",
            interpolation="nearest",
            **limits,
        )
        text = f"{title} ({unit})" if name == "variability" else title
        panel.set_title(text)
        panel.grid(False)
        # as tall as the map, whose shape is its own
        figure.colorbar(image, cax=panel.inset_axes((1.03, 0.0, 0.04, 1.0)))
    for panel in panels[1]:
        panel.set_xlabel("longitude (deg)")
    for panel in panels[:, 0]:
        panel.set_ylabel("latitude (deg)")
    return figure
