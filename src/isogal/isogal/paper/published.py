"""What the paper publishes: the numbers of its Tables 4 and 6 and of its text (Wang et al.,
NAVIGATION 70(2), navi.583)."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class PublishedRow:
    """A row of Table 4 (gravity) or 6 (disturbance): 100 runs with the precision grade."""

    quantity: str
    batch_length: int
    sigma: float
    """m/s², 1-sigma of the gravimeter."""
    snr: float
    """dB, as printed."""
    mean_error: float
    """m."""
    divergence_rate: float
    """Share of the runs."""


TABLE_4 = (
    PublishedRow("gravity", 30, 1e-5, 120.0, 507.0, 0.0),
    PublishedRow("gravity", 15, 1e-5, 120.0, 510.0, 0.0),
    PublishedRow("gravity", 30, 2e-4, 93.0, 1820.0, 0.06),
    PublishedRow("gravity", 15, 2e-4, 93.0, 4199.0, 0.22),
)
TABLE_6 = (
    PublishedRow("disturbance", 30, 1e-6, 51.0, 544.0, 0.0),
    PublishedRow("disturbance", 15, 1e-6, 51.0, 868.0, 0.13),
    PublishedRow("disturbance", 30, 4e-5, 20.0, 1056.0, 0.13),
    PublishedRow("disturbance", 15, 4e-5, 20.0, 2673.0, 0.69),
)
ROWS = TABLE_4 + TABLE_6
LOW = {"gravity": 1e-5, "disturbance": 1e-6}
HIGH = {"gravity": 2e-4, "disturbance": 4e-5}

QUANTUM_GAIN = 0.06
"""Section 4.2.1: by how much quantum accelerometers reduce the RMS position error of the unaided
navigator "after 3.5 hours"."""
GAIN_TIME = 3.5 * 3600.0
"""s."""
BENEFIT_TIME = 2.0 * 3600.0
"""s; section 4.2.1: when the benefit of aiding appears."""
SPEED = 22.0
"""m/s; section 4.2."""
ITERATIONS = 15
"""Section 3.2: beyond these almost no difference between iterations is observed."""
FIGURE_54_READING_SIGMA = 0.9776e-5
"""m/s², sigma of fig-54."""
FIGURE_54_CANDIDATES = 50
FIGURE_54_SIDE = 5000.0
"""m, side of fig-54's search window."""
FIGURE_64_SCAN = 4951
"""Scan of fig-64; with a navigation rate of 1 Hz, its time in seconds."""
