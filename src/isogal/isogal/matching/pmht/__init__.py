"""The default matcher: probabilistic multi-hypothesis matching with an exact batch likelihood.

The way of a batch, one stage a file (docs/mathematics.md gives the mathematics by section):

    matcher                the six stages in order; what monitors may ask
    prepare                1  prior, noise model, sensor bias and likelihood of the batch
    outliers               2  readings that cannot be right, before and after the place is known
    update                 3  posterior; uneven map error; does the batch agree with the map?
    learn                  4  what the batch says about the map error
    assess                 5  fix, ambiguity, bias, lost navigator or larger noise
    publish                6  the fix and what is remembered
    state                  what the stages hand on, and `rematch`: matching under other assumptions
    memory                 what is carried from batch to batch
    settings, constants    what a user may change; what he should not have to

What the stages use:

    likelihood             log-likelihood of a batch given the navigator's error
    likelihood_kernels     its compiled loops
    noise_model            residual covariance: sensor, correlated map error, bias
    filtered               readings that are a mean over the path
    map_error              sigma and correlation length of the map error, learnt
    sensor_bias            bias, drift and other constants of the readings, learnt
    wandering              what becomes of those that change from batch to batch
    delay                  readings that are later than told
    attitude               the attitude error that goes with position and velocity
    hypotheses             update of several hypotheses
    nearly_linear          posterior of a narrow prior, without sampling noise
    importance_sampling    posterior of one of them by tempered importance sampling
    acquisition            search on a grid for a very uncertain navigator
    gaussian_mixture       sums of Gaussians
    clustering             from samples to Gaussians
    contours               candidates on iso-value contours, for display

What watches the matcher from outside (`isogal.matching.monitoring`):

    lost_navigator         finds a navigator that is lost without knowing it
    elsewhere              do the readings fit much better somewhere else?
    last_hour              readings as one track, and what the navigator's errors do to them
    other_fields           what do other fields say of that?
    past_batches           what is remembered for that
    assumptions_monitor    finds out that what was told is wrong: navigator, fixes, delay
    error_hypotheses       the bank of linear filters that it asks
    robust                 fixes of recorded tracks that do not rest on the noise model alone
"""
