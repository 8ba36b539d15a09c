"""Overrides of scenarios that measure something else than gravity."""

SHORT = (
    "route.duration=600.0",
    "matcher.batch_length=15",
    "matcher.stride=15",
    "initial_error.position=300.0",
    "gravity.field=normal",
)
SCOTLAND = (
    *SHORT, "field=magnetic", "gravimeter.sigma=2.0", "route.start=[55.7, -4.6]",
    "route.end=[56.2, -3.6]", "route.height=300.0", "route.speed=40.0",
)  # fmt: skip
ALPS = (
    *SHORT, "field=terrain", "gravimeter.sigma=5.0", "route.start=[-36.9, 147.2]",
    "route.end=[-36.5, 148.2]", "route.height=2600.0", "route.speed=40.0",
)  # fmt: skip
GRADIENT = (
    "gravimeter.quantity=gravity", "field=gradient", "gradiometer.components=[ne, nd, ed]",
    "gradiometer.covariance_eotvos=[[4, 1, 0], [1, 4, 0], [0, 0, 9]]",
    "matcher.name=pmht", "initial_error.position=300.0",
)  # fmt: skip
