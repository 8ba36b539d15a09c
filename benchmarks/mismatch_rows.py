"""The rows of `mismatch.py`: what differs from what is assumed."""

from dataclasses import dataclass

FINE, COARSE, RATED, MAGNETIC = "{fine}", "{coarse}", "{rated}", "{magnetic}"
"""Stand for map files: the map, the same of twice its grid spacing, without and with its 1-sigma
at each node, a magnetic one."""


@dataclass(frozen=True)
class Row:
    """One way in which the world differs."""

    name: str
    world: tuple[str, ...] = ()
    """Settings of what really is."""
    told: tuple[str, ...] = ()
    """What the matcher is told besides where it is told; filter and matcher then also know
    `world`."""
    base: tuple[str, ...] | None = None
    """Settings instead of the base of all rows (a map 3 mGal wrong, told)."""
    untold: bool = True
    """Whether there is something to keep from the navigator."""
    tellable: bool = True
    """Whether there is a way to tell."""
    bound: tuple[str, ...] = ()
    """Settings of the bound, where the world does not say it all."""
    unknown: tuple[str, ...] = ()
    """Settings of the bound where nothing is told: what nobody knows is a state of it, with the
    1-sigma that it has in the matcher's model of it."""


EXACT = ("map_error.sigma=0", "matcher.map_sigma=0")
MGAL_3 = ("map_error.sigma=3e-5", "matcher.map_sigma=3e-5")
OVER_KALGOORLIE = (
    "field=magnetic",
    f"map.source={MAGNETIC}",
    "map.variable=magnetic_anomaly",
    "gravimeter.sigma=2.0",
    "route.start=[-32.25, 120.95]",
    "route.end=[-30.1, 122.35]",
    "route.height=300",
    "route.duration=12000",
    "map_error.sigma=5.0",
    "matcher.map_sigma=5.0",
)
GRADIENTS = (
    "field=gradient",
    "gradiometer.sigma_eotvos=10",
    "map_error.sigma=1.5e-8",
    "map_error.correlation_length=700",
    "matcher.map_sigma=1.5e-8",
    "matcher.map_correlation_length=700",
)
"""A map of the disturbance that is 3 mGal wrong over 4 km, in its gradients (docs/maps.md)."""
GROUND = (
    "field=terrain",
    "map.variable=height",
    "gravimeter.sigma=5",
    "route.height=2500",
    "map_error.sigma=10",
    "map_error.correlation_length=1000",
    "matcher.map_sigma=10",
    "matcher.map_correlation_length=1000",
)
"""Clearance above ground by an altimeter."""
BAROMETER = (
    *MGAL_3,
    "height.source=barometer",
    "height.bias=0.5",
    "height.scale=0",
    "height.weather_sigma=0.5",
    "height.weather_time=600",
)
"""One that is taken to be good."""
LOG = (*MGAL_3, "velocity.kind=log", "velocity.scale=0", "velocity.current_sigma=0")
"""A speed log, taken to be without scale factor error, in still water."""
TURNS = (
    "route.waypoints=[[-37.9, 144.8, 22], [-37.6, 145.2, 18], [-37.75, 145.7, 25],"
    " [-37.3, 146.0, 22], [-37.35, 146.6, 20], [-36.9, 147.2, 22]]"
)
BIAS_5 = "matcher.bias_sigma=5e-5"

ROWS = (
    Row("nothing", untold=False),
    Row("IMU 3 times worse", ("imu=3x",)),
    Row("IMU 10 times worse", ("imu=10x",)),
    Row(
        "IMU biases not constant: 1 ug and 1e-4 deg/h over 1000 s",
        (
            "imu.accelerometer.bias_instability=1ug",
            "imu.accelerometer.bias_time=1000s",
            "imu.gyroscope.bias_instability=1e-4deg/h",
            "imu.gyroscope.bias_time=1000s",
        ),
    ),
    Row(
        "IMU scale factors 10 ppm, misalignments 2″",
        (
            "imu.accelerometer.scale_factor=10ppm",
            "imu.accelerometer.misalignment=2arcsec",
            "imu.gyroscope.scale_factor=10ppm",
            "imu.gyroscope.misalignment=2arcsec",
        ),
    ),
    Row("initial errors 3 times larger", ("initial_error=3x",)),
    Row("gravimeter noise 3 times larger", ("gravimeter.sigma=3x",)),
    Row("gravimeter noise 20 times larger", ("gravimeter.sigma=20x",)),
    Row(
        "gravimeter bias 5 mGal, drift 1 mGal/h",
        ("gravimeter.bias=5e-5", "gravimeter.drift=2.8e-9"),
        (BIAS_5,),
    ),
    Row(
        "gravimeter noise correlated: 1 mGal over 60 s",
        ("gravimeter.correlated_sigma=1e-5", "gravimeter.correlation_time=60"),
    ),
    Row(
        "gravimeter noise correlated: 3 mGal over 120 s",
        ("gravimeter.correlated_sigma=3e-5", "gravimeter.correlation_time=120"),
    ),
    Row("gravimeter bias walks 1 mGal in an hour", ("gravimeter.bias_walk=1.7e-7",)),
    Row("readings 20 s late", ("gravimeter.delay=20",), unknown=("gravimeter.delay_sigma=20",)),
    Row(
        "readings 20 s late, told that they may be by 20 s",
        ("gravimeter.delay=20",),
        base=(*MGAL_3, "gravimeter.delay_sigma=20"),
        tellable=False,
    ),
    Row("clock of the gravimeter 2 s off", ("gravimeter.delay=2",), tellable=False),
    Row(
        "clock of the gravimeter 2 s off, told that it may be by 2 s",
        ("gravimeter.delay=2",),
        base=(*MGAL_3, "gravimeter.delay_sigma=2"),
        tellable=False,
    ),
    Row(
        "gravimeter with a low-pass filter of 30 s",
        ("gravimeter.filter_time=30",),
        unknown=("gravimeter.delay_sigma=9",),
    ),
    Row(
        "gravimeter with a low-pass filter of 120 s",
        ("gravimeter.filter_time=120",),
        unknown=("gravimeter.delay_sigma=36",),
    ),
    Row(
        "readings 20 s late, route with turns",
        ("gravimeter.delay=20",),
        base=(*MGAL_3, TURNS),
        unknown=("gravimeter.delay_sigma=20",),
    ),
    Row(
        "readings 15 s late through a low-pass filter of 30 s, route with turns",
        ("gravimeter.delay=15", "gravimeter.filter_time=30"),
        base=(*MGAL_3, TURNS),
        unknown=("gravimeter.delay_sigma=20",),
    ),
    Row(
        "gravimeter takes 1 mGal from 0.01 m/s², route with turns",
        ("gravimeter.cross_coupling=1e-3",),
        base=(*MGAL_3, TURNS),
    ),
    Row(
        "gravimeter's platform 2e-3 rad off level, over 300 s",
        ("gravimeter.platform_tilt=2e-3",),
    ),
    Row(
        "height from a barometer, 20 m off",
        ("height.bias=20",),
        base=BAROMETER,
    ),
    Row(
        "height from a barometer, wrong by 10 m over 600 s",
        ("height.weather_sigma=10",),
        base=BAROMETER,
    ),
    Row(
        "height from a barometer, wrong by 10 m over 2 h",
        ("height.weather_sigma=10", "height.weather_time=7200"),
        base=BAROMETER,
    ),
    Row(
        "height from a barometer, readings of 0.1 mGal every 5 s",
        base=(
            "height.source=barometer",
            "gravimeter.quantity=disturbance",
            "gravimeter.sigma=1e-6",
            "gravimeter.interval=5",
        ),
        untold=False,
    ),
    Row(
        "speed log with a scale factor error of 1 %",
        ("velocity.scale=0.01",),
        base=LOG,
    ),
    Row(
        "speed log in a current of 0.3 m/s",
        ("velocity.current_sigma=0.3",),
        base=LOG,
    ),
    Row(
        "Doppler log 3 times worse, with scale and mounting",
        ("velocity=3x",),
        base=(*MGAL_3, "velocity.kind=dvl"),
    ),
    Row("half of the readings missing", ("gravimeter.missing_fraction=0.5",), untold=False),
    Row("no readings for 20 min", ("gravimeter.gaps=[[5400, 1200]]",), untold=False),
    Row("5 % outliers of 50 sigma", ("gravimeter.outlier_fraction=0.05",), tellable=False),
    Row("map 3 mGal wrong", ("map_error.sigma=3e-5",), ("matcher.map_sigma=3e-5",), EXACT),
    Row("map 8 mGal wrong", ("map_error.sigma=8e-5",), ("matcher.map_sigma=8e-5",)),
    Row(
        "map error over 1 km instead of 4 km",
        ("map_error.correlation_length=1000",),
        ("matcher.map_correlation_length=1000",),
    ),
    Row("map datum 5 mGal off", ("map_error.offset=5e-5",), (BIAS_5,)),
    Row("map tilted by 5 mGal in 100 km", ("map_error.tilt=5e-10",), (BIAS_5,)),
    Row(
        "map of twice the grid spacing",
        (f"map.source={FINE}",),
        (f"map.source={RATED}", "matcher.map_correlation_length={length}"),
        (*EXACT, f"map.source={COARSE}", "map.continuation=none"),
        bound=("map_error.sigma={residual}", "map_error.correlation_length={length}"),
    ),
    Row("the IMU feels the real gravity vector", ("gravity.field=map",)),
    Row(
        "the same, nothing of it compensated",
        base=(*MGAL_3, "gravity.field=map", "gravity.compensation=none"),
        untold=False,
    ),
    Row(
        "the same, 20 % left after compensation",
        ("gravity.residual_sigma=auto", "gravity.residual_correlation_length=auto"),
        base=(
            *MGAL_3,
            "gravity.field=map",
            "gravity.compensated_share=0.8",
            "gravity.residual_sigma=2.1e-5",
            "gravity.residual_correlation_length=4000",
        ),
    ),
    Row(
        "the same, map of twice the grid spacing",
        (f"map.source={FINE}",),
        (f"map.source={RATED}", "matcher.map_correlation_length={length}"),
        (*EXACT, "gravity.field=map", f"map.source={COARSE}", "map.continuation=none"),
        bound=("map_error.sigma={residual}", "map_error.correlation_length={length}"),
    ),
    Row(
        "magnetic field of the year 2015 instead of 2025",
        ("magnetometer.epoch=2015",),
        base=OVER_KALGOORLIE,
    ),
    Row("magnetometer noise 3 times larger", ("gravimeter.sigma=3x",), base=OVER_KALGOORLIE),
    Row("gradiometer noise 3 times larger", ("gradiometer.sigma_eotvos=3x",), base=GRADIENTS),
    Row("altimeter noise 3 times larger", ("gravimeter.sigma=3x",), base=GROUND),
)
