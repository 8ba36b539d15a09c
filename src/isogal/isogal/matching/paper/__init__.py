"""`pmht-paper`: the published algorithm to the letter (docs/mathematics.md, section 13).

matcher       the matcher: options, fix
iteration     candidates and iterations
map_lookup    search window and map look-up function
pda           association weights, weighted mean and variance of candidates
kalman        constant-velocity Kalman filter and smoother of a batch
"""
