"""Monte Carlo: a scenario many times, as one array computation, spread over workers, kept on disk.

engine          runs of a scenario in closed loop
field_runs      the readings of one field in the loop
aids            sensors of height and velocity in the loop
recorder        what the loop leaves behind, collected while it runs
chunks          cases, and the chunks of runs that workers compute
store           finished chunks on disk
workers         who computes them: processes on this machine, or a Dask cluster
study           cases to results: what is on disk is taken, the rest computed
viewing         a run of a finished study, as `isogal view` shows it
progress        live progress on the standard error stream
"""
