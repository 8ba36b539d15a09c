"""Map matching: batches of readings in, position fixes out.

    interfaces             what a matcher is given and what it gives back
    registry               matchers by name (entry points `isogal.matchers`)
    scans                  scans that have been collected
    batching               from scans, one by one, to batches
    transitions            the error at each scan per unit of that at the end; gaps between them
    path                   where the navigator was, for readings that are late
    reading_noise          covariance of the readings' noise, as specified
    expansion              readings that are more than one number: channels, the own field of a
                           vehicle, footprints of several beams
    parameters             constants, or what changes slowly, estimated along
    map_matching           readings of all fields of a run to fixes
    usability              whether a batch can be used at all
    failures               a matcher that raises declines the batch
    information            from a posterior back to what the measurements alone said
    quasi_random           Sobol points, uniform and normal

Matchers:

    pmht                   the default
    paper                  `pmht-paper`, the published algorithm to the letter
    baselines              tercom, iccp, sitan, particle, point-mass, viterbi
"""
