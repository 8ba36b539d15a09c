"""Matching: Isogal's `pmht-paper` and Stone Soup's PMHT tracker, on the same batches."""

import datetime
import time

import numpy as np
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.transition.linear import (
    CombinedLinearGaussianTransitionModel,
    ConstantVelocity,
)
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.smoother.kalman import KalmanSmoother
from stonesoup.tracker.pmht import PMHTTracker
from stonesoup.types.detection import Detection
from stonesoup.types.state import GaussianState
from stonesoup.updater.kalman import KalmanUpdater

from isogal.arrays import Array
from isogal.maps.field_map import FieldMap
from isogal.matching.interfaces import Batch, Candidates
from isogal.matching.local_plane import LocalPlane
from isogal.matching.paper.iteration import PaperOptions
from isogal.matching.paper.kalman import constant_velocity
from isogal.matching.paper.matcher import PmhtPaper

BATCHES = 6
ITERATIONS = 15
REPEATS = 20
ACCELERATION_DENSITY = 1e-5
"""m²/s³."""
CANDIDATE_SIGMA = 250.0
"""m."""
MEASUREMENT = LinearGaussian(4, (0, 2), np.eye(2) * CANDIDATE_SIGMA**2)
TRANSITION = CombinedLinearGaussianTransitionModel([ConstantVelocity(ACCELERATION_DENSITY)] * 2)


def measure_matching(batches: list[Batch], field_map: FieldMap) -> dict[str, float]:
    """CPU seconds of both PMHTs per batch; how far apart they put the last scan (median, m)."""
    paper = PmhtPaper(PaperOptions(iterations=ITERATIONS))
    theirs, mine, apart = [], [], []
    for batch in batches[:BATCHES]:
        fix, _ = paper.match(batch, field_map, None)
        if fix.candidates is None:
            continue
        begin = time.thread_time()
        for _ in range(REPEATS):
            paper.match(batch, field_map, 1e-9)
        mine.append((time.thread_time() - begin) / REPEATS)
        scans, start = _scans(batch, fix.candidates), _start(batch)
        begin = time.thread_time()
        last = _match(scans, start)
        theirs.append(time.thread_time() - begin)
        there = LocalPlane.of(batch).metres(np.array([fix.latitude]), np.array([fix.longitude]))[0]
        apart.append(np.hypot(*(last - there)))
    if not np.median(apart) < 1500.0:
        raise SystemExit(
            f"Stone Soup's fixes are {np.median(apart):.0f} m from ours: not the same work"
        )
    return {
        "stonesoup": float(np.mean(theirs)),
        "isogal": float(np.mean(mine)),
        "apart_m": float(np.median(apart)),
    }


Scans = list[tuple[datetime.datetime, set[Detection]]]


def _scans(batch: Batch, candidates: Candidates) -> Scans:
    """Return the candidates of the paper's matcher as detections of each scan."""
    places = LocalPlane.of(batch).metres(candidates.latitude, candidates.longitude)
    epoch = datetime.datetime(2000, 1, 1)
    scans = []
    for t, stamp in enumerate(batch.time):
        when = epoch + datetime.timedelta(seconds=float(stamp))
        mine = places[candidates.scan == t]
        detections = {
            Detection(place[:, None], when, measurement_model=MEASUREMENT) for place in mine
        }
        scans.append((when, detections))
    return scans


def _start(batch: Batch) -> tuple[Array, Array]:
    """Return mean and covariance of the navigator's state at the first scan, from the prior at the
    last."""
    place = LocalPlane.of(batch).metres(batch.latitude[:1], batch.longitude[:1])[0]
    back = np.linalg.inv(constant_velocity(np.diff(batch.time[:2]), ACCELERATION_DENSITY)[0][0])
    order = np.array([0, 2, 1, 3])  # Stone Soup interleaves position and velocity
    prior = (back @ batch.prior @ back.T)[np.ix_(order, order)]
    mean = np.array([place[0], batch.velocity[0, 0], place[1], batch.velocity[0, 1]])[:, None]
    return mean, prior


def _match(scans: Scans, start: tuple[Array, Array]) -> Array:
    """Let Stone Soup match a batch; return the position (2,) m of the last scan."""
    tracker = PMHTTracker(
        detector=iter(scans),
        predictor=KalmanPredictor(TRANSITION),
        updater=KalmanUpdater(MEASUREMENT),
        smoother=KalmanSmoother(TRANSITION),
        meas_range=np.array([[-2500.0, 2500.0], [-2500.0, 2500.0]]),
        clutter_rate=19.0,
        detection_probability=0.99,
        batch_len=len(scans),
        overlap_len=0,
        update_log_pi=False,
        init_priors=[GaussianState(*start, timestamp=scans[0][0])],
        max_num_iterations=ITERATIONS,
    )
    tracker.detector_iter = iter(scans)
    _, (track,) = next(tracker)
    mean = track[-1].mean
    return np.array([float(mean[0]), float(mean[2])])
