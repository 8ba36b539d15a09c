"""The paper's claims, each decided from what was measured: holds, does not hold, cannot tell.

Means of the same runs are compared in pairs (the same random numbers), and a difference counts
from two of its standard errors. Shares of diverged runs are compared by their exact binomial 95 %
intervals. The claims are about the paper's own matcher, and so are the verdicts.

    judge         all claims, decided in the paper's order
    verdicts      what a claim, a rule and a verdict are
    statistics    statistics by which claims are decided
    reasons       likely causes where a claim does not hold
    method        map look-up, iterations, retrodiction, variability
    navigator     the navigator's error over time, unaided and aided
    errors        errors and divergence by noise, batch length and map
    discussion    claims of the paper's discussion
"""
