"""The constants of `pmht` and its monitors, each with its unit and where it comes from.

"measured" means: chosen by Monte Carlo runs over the two maps of docs/matchers.md, and results
change little when it is varied by a half. What a user may want to change is in `settings` instead.
Those of the sampler are in `importance_sampling.Sampling`. Sections are of docs/mathematics.md.
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Constants:
    """See the module."""

    # Outliers (sections 8.1, 8.2)
    innovation_gate_excess_sigma: float = 2.0
    """Added to the outlier gate before the place is known: a wrong place must not make outliers
    of good readings. Measured."""
    wrong_place_length_m: float = 1500.0
    """Over which the residuals of a wrong place are smooth: features of the maps. Measured."""
    largest_outlier_share: float = 0.4
    """Of a batch's readings; with more the model is wrong, not the readings. Below one half, where
    no method can tell which are right (Rousseeuw & Leroy 1987, section 1.2)."""
    outlier_probability: float = 0.01
    """A priori, for the evidence of a batch. Usual for field instruments."""

    # Update (sections 6.2 to 6.8)
    wide_prior_m: float = 600.0
    """1-sigma of position beyond which a prior gets four times the samples. Measured."""
    very_wide_prior_m: float = 1500.0
    """Beyond this, four times as many again in the first round: fewer overlook a place of some
    tenths of a percent. Measured."""
    search_prior_m: float = 3000.0
    """Beyond this a prior is searched on a grid at once, not only where sampling has failed.
    Measured."""
    more_samples: int = 4
    """Factor of the samples for a wide prior, and for hypotheses sampled together."""
    fewest_samples: int = 128
    """Per hypothesis, however many there are. Measured."""
    least_effective_samples: float = 20.0
    """Of a resolved posterior: the error of its mean is then below a quarter of its 1-sigma."""
    negligible_weight: float = 1e-6
    """A hypothesis of less weight is dropped."""
    sampled_hypotheses: int = 32
    """Hypotheses sampled one by one; of more, those that a few points find most likely."""
    screening_samples: int = 32
    """Points of each hypothesis in that screening."""
    update_look_ups: int = 8_000_000
    """Readings looked up in the map for one update, from which on no further hypothesis is
    sampled: a tenth of a second. Of a batch with many readings, for each of which there is more to
    compute, fewer (`search_batch_readings`)."""
    readings_squared_of_point: int = 50
    """The new readings' number squared over this is how many points take as long as what else
    there is to compute for a round of them. Measured."""
    screening_slack_log_evidence: float = 5.0
    """What screening may be wrong by when it calls a hypothesis negligible. Measured."""
    mode_separation: float = 4.0
    """Two groups of samples are different hypotheses where sqrt(2) |m1 - m2| / sqrt(s1² + s2²)
    along an axis exceeds this (Ashman, Bird & Zepf 1994, AJ 108:2348, who call 2 clean for two
    Gaussians; the two halves of one cut Gaussian already reach 2.7)."""
    cut_effective_samples: float = 40.0
    """A piece of a posterior with fewer is not cut: each half keeps at least 20."""
    refinements: int = 6
    """Times at most that the error of an uneven map is taken anew where the readings turn out to
    be; more change nothing on real maps. Measured."""
    agreement_variance_share: float = 0.25
    """Two means agree when they are closer than half a 1-sigma: 0.5 squared."""

    # Search on a grid (section 6.7)
    search_reach_sigma: float = 3.0
    """Half-width of the search in prior 1-sigmas."""
    coarse_cells: int = 40_000
    """Cells of the first grid at most: bounds the time of a search. Of a batch with many readings
    fewer (`search_batch_readings`)."""
    fine_cells: int = 60_000
    """Cells of each finer grid at most."""
    given_up_share: float = 1e-3
    """Probability of the cells beyond those at most from which on none is divided: the search
    stays coarse, and with it what is known of the place."""
    finest_cell_m: float = 100.0
    """Smallest cells: sampling takes over."""
    fine_enough_sigma: float = 0.5
    """Cells in which the map changes by less than this share of the residuals' 1-sigma are not
    divided any more."""
    tile_cells: int = 3
    """Cells to a tile, each way."""
    search_batch_readings: int = 60
    """Of a batch with more, as of several channels, the older scans are left out of the search but
    for `conditioning_readings`, and grids and screening have fewer cells and points in proportion:
    what a search takes grows with the product."""
    search_depth_log: float = 25.0
    """Cells whose log posterior lies this far below the best are given up: e⁻²⁵ = 1e-11."""

    # Nearly linear updates (section 6.9)
    linear_prior_m: float = 300.0
    """1-sigma of position up to which a linear problem is tried: features of maps are larger.
    Measured."""
    newton_steps: int = 8
    """At most; a nearly linear problem needs two or three."""
    newton_tolerance: float = 0.01
    """Length of the last step in 1-sigmas of the posterior."""
    linear_points: int = 64
    """That are weighted."""
    linear_effective_share: float = 0.9
    """Effective share of them that a nearly linear problem has. Measured."""
    linear_reach_sigma: float = 2.5
    """1-sigmas of the prior at which residuals must be nearly linear still."""
    linear_tolerance: float = 0.5
    """By which they may depart there, as a share of their change (of 1 where that is less)."""

    # Posterior carried on in its own shape (section 6.8)
    carried_shape_m: tuple[float, float] = (100.0, 1000.0)
    """1-sigma between which the shape of a posterior is carried on: a narrower one is Gaussian, a
    wider one goes on as separate hypotheses. Measured."""
    shape_cuts: int = 3
    """Times that it is cut in halves."""
    least_shape_gain_log: float = -0.05
    """Log density per sample by which the pieces must describe the samples better than one
    Gaussian does. Of a Gaussian they are 0.1 worse; slight departures are carried, too, since
    they add up from batch to batch. Measured."""

    # Variance factor (section 8.4)
    variance_factor_freedom: float = 60.0
    """Degrees of freedom of the prior at 1: two batches of 30 readings."""
    variance_factor_sigma: float = 4.0
    """1-sigmas by which the estimate must exceed 1 before it counts."""
    variance_factor_memory: float = 0.9
    """What a batch's weight is multiplied by with each further batch: some ten batches count."""

    # Batches that do not agree (section 8.5)
    disagreements_tolerated: int = 1
    """Batches in a row that are declined without a search, where the misfit is large."""
    explained_variance_factor: float = 4.0
    """Variance factor that a noise model wrong by two in sigma explains."""
    elsewhere_log_evidence: float = 8.0
    """By which a place elsewhere must beat the best one near the navigator; the wide prior itself
    already counts against it. Measured: no false alarm in 100 runs of 3.6 h of any case."""
    lost_on_any_map_log_evidence: float = 2.0
    """Which a place elsewhere must have as well if the map's error may be another than told. On an
    exact map that of lost navigators was 2.5 to 23, on a map 20 times worse than told that of
    others below 0. Measured."""
    told_probability: float = 0.99
    """That the map's error is as told, to somebody who asks whether the navigator is elsewhere.
    With less a navigator that is lost on an exact map is found later, with more one on a map that
    is far worse than told may be sent away."""
    bias_log_evidence: float = 3.0
    """By which a bias of the readings must beat a place elsewhere: "strong" (Kass & Raftery 1995,
    J. Am. Stat. Assoc. 90:773)."""

    # Map error learnt (section 9.1)
    least_sigma_noise_share: float = 0.03
    """Least sigma of the grid where nothing was told, in 1-sigmas of a reading's noise: a map
    error that cannot be told from none."""
    largest_sigma_share: float = 0.5
    """Largest sigma of that grid, as a share of the map's standard deviation."""
    sigma_grid_factor: float = 2.0**0.25
    """Between points of the grid of an unknown sigma. Good readings show sigma² / L, the growth of
    the map's error from reading to reading, far better than either: two steps here are one of the
    lengths, so that no length is preferred because the grid has a better sigma to it."""
    coarse_steps: tuple[int, int] = (5, 2)
    """Of the grids of sigma and length, that a look takes a point in each of."""
    unknown_sigma_factor: float = 5.0
    """1-sigma, as a factor, by which an untold sigma exceeds the map's roughness."""
    unknown_length_factor: float = 2.5
    """1-sigma, as a factor, of an untold correlation length. Measured maps are within it
    (docs/real-data.md)."""
    doubtful_sigma_share: float = 0.15
    """Sigma of the map's error, as a share of the map's standard deviation, above which it is
    asked whether the navigator is lost where nothing was told. Measured."""
    unknown_lengths_m: tuple[float, float, int] = (500.0, 16000.0, 6)
    """Grid of an unknown correlation length: of the maps that are known to us."""
    told_steps: tuple[int, int] = (17, 9)
    """Points of the grids of sigma and length about what was told, over two 1-sigmas each way."""
    conditioning_readings: int = 10
    """Older residuals that new ones are conditioned on; still older ones say little more.
    Measured."""
    changed_noise_factor: float = 1.2
    """Factor in sigma or length from which a batch is matched again with what was learnt."""

    # Sensor bias (section 9.3)
    no_bias_log_evidence: float = 3.0
    """Log Bayes factor for no bias, or for no drift, from which there is none: "strong" (Kass &
    Raftery 1995)."""
    unknown_bias_share: float = 0.5
    """1-sigma of an untold bias, as a share of the map's standard deviation."""
    bias_drift_time_s: float = 10800.0
    """Time in which an untold drift changes the bias by its own 1-sigma: three hours."""
    taken_fix_variance_ratio: tuple[float, float] = (0.7, 1.5)
    """Between which the navigator's variances show that it has taken a published fix.
    Measured."""

    # Lost-navigator monitor (section 8.7)
    doubt_log_evidence: float = 4.0
    """Log Bayes factor against the map error as told that starts the search; that of navigators
    that are not lost stayed below 2.5. Measured."""
    renewed_doubt_factor: float = 10.0
    """By which it must have grown for the next search once the navigator's place was confirmed."""
    look_log_evidence: float = 12.0
    """Log Bayes factor of a quick look (`elsewhere`) that starts the search: being lost is a rare
    thing to believe. Over a map 8 mGal wrong it was 11.8 for a wrong place once in some thousand
    hours; navigators that are lost are found as soon as with 6. Measured."""
    first_look_readings: int = 120
    """After which there is a first look: a third of an hour. With half as many a wrong place may
    look better than the right one. Measured."""
    look_every_readings: int = 60
    """New ones from look to look."""
    not_lost_log_evidence: float = 5.0
    """Log Bayes factor of a look against another place after which the next one has time; of
    navigators that were lost it was never more than 2.7. Measured."""
    next_look_if_not_lost_readings: int = 180
    """It has: half of the hour that a look sees."""
    next_look_if_lost_readings: int = 15
    """Where the navigator is more likely lost than not, but the place not yet known."""
    look_groups: int = 72
    """Means of readings that a look takes: an hour's readings in groups of five."""
    look_own_points: int = 64
    """Of the navigator's own prior."""
    look_reach_m: float = 24_000.0
    """1.6 times the 1-sigma of a lost navigator, each way."""
    look_cell_m: float = 500.0
    """Cells of the look: features of maps are wider. Measured."""
    look_best_cells: int = 30
    """That are divided. Measured."""
    look_fine_cell_m: float = 50.0
    """Into such cells: a place is rarely known better by an hour's readings taken as a whole."""
    look_one_place_m: float = 1500.0
    """Places closer to the best one than this count as one."""
    look_negligible_share: float = 0.1
    """Of a group's noise, below which a component of the navigator's own error in the readings is
    left out."""
    look_place_probability: float = 0.8
    """Of that place, where a search begins there: it is to decide, and it may be wrong."""
    found_probability: float = 0.99
    """Of that place, from which on it is told to a navigator that knows that it is lost."""
    look_bent_track_m: float = 500.0
    """1-sigma by which the navigator's own fixes may have bent its track. Measured."""
    moved_log_evidence: float = 8.0
    """By which the other place must be ahead: as `elsewhere_log_evidence`."""
    others_against_log_evidence: float = 0.0
    """By which readings of other fields may be against it. With 1 a place 650 m away that gravity
    liked by 10 and magnetics not at all was believed, wrongly."""
    same_place_probability: float = 0.95
    """That the search gives the navigator's own place before it ends."""
    same_place_m: float = 500.0
    """On top of `same_place_sigma` of its 1-sigmas: within this of the navigator is its place."""
    same_place_sigma: float = 3.0
    """See `same_place_m`."""
    remembered_readings: int = 360
    """Of the past, an hour at one in ten seconds, which the search is given first."""
    search_readings: int = 30
    """New readings that a search matches at once; of shorter batches several together. Measured:
    fewer leave more places open, each of which takes time."""
    past_batches_at_once: int = 4
    """Matched along with a new one, of one channel: the search is wide, and the new fix must not
    wait for long."""
    search_context_readings: int = 10
    """Older readings that the search sees of a batch: they tell most about the map error."""
    search_readings_at_most: int = 1080
    """After which a search that is still ambiguous is given up."""

    # What nobody has told (section 8.8)
    navigator_variance_factors: tuple[float, ...] = (1.0, 2.0, 4.0, 10.0, 30.0, 100.0, 300.0)
    """Of the navigator's covariance, that are tried."""
    growth_variance_factors: tuple[float, ...] = (10.0, 30.0, 100.0)
    """Of what it grows by, that are tried where its start is as told."""
    fix_variance_factors: tuple[float, ...] = (1.0, 3.0, 10.0, 30.0)
    """Of the covariance of fixes, that are tried."""
    unknown_delay_s: float = 15.0
    """1-sigma of a delay that is tried: filters of gravimeters take up to a minute."""
    untold_log_prior: float = -5.0
    """Log prior odds of each such hypothesis: what is told is mostly right."""
    untold_reach_log: float = 15.0
    """By which a hypothesis may fall behind the best: what was wrong may become right."""
    assumptions_probability: tuple[float, float] = (0.3, 0.9)
    """Of what was told: below the first it is in doubt, above the second no more."""
    doubted_prior_factor: float = 2.0
    """Of the covariance that batches are matched with while what was told is in doubt: what a fix
    says holds about its prior. Measured."""
    aided_states: float = 0.1
    """Of the navigator's seven, that are known by something else than its dynamics, from which on
    it counts as aided."""
    lost_m: float = 5000.0
    """1-sigma of its position from which on a navigator knows that it is lost."""
    telling_information: float = 0.04
    """In units of the navigator's own, of the directions of a fix that are judged: in others what
    is left is how far its likelihood is from a Gaussian. Measured."""

    # Map errors of the gradient tensor (section 12.4)
    of_one_potential: float = 0.85
    """Share of the variance that maps say of themselves which comes from one potential: between
    nodes each component is interpolated by itself. Measured by the errors of a shift that a batch
    of 45 scans tells on maps with nodes 0.9 km apart (docs/maps.md)."""

    # Recorded tracks (section 10.2)
    sceptical_variance_factor: float = 4.0
    """Of twice the noise."""
    sceptical_confidence: float = 0.9
    """Probability that the place needs with it."""
    informed_share: float = 0.01
    """Information in units of the prior's under which a direction is left alone."""
    sandwich_sigma: float = 2.0
    """1-sigmas of chance by which the score's covariance must exceed the curvature."""


CONSTANTS = Constants()
