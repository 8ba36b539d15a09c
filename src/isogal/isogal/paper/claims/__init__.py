"""The paper's claims, each decided from what was measured: holds, does not hold, cannot tell.

Means of the same runs are compared in pairs (the same random numbers), and a difference counts
from two of its standard errors. Shares of diverged runs are compared by their exact binomial 95 %
intervals. The claims are about the paper's own matcher, and so are the verdicts.

============  =================================================================
judge         All claims in the paper's order, and their verdicts
verdicts      What is a claim, a rule, a verdict?
statistics    Which statistics decide?
reasons       Why does a claim not hold?
method        Map look-up, iterations, retrodiction, variability
navigator     The navigator's error over time, unaided and aided
errors        Errors and divergence by noise, batch length and map
discussion    The claims of the paper's discussion
============  =================================================================
"""
