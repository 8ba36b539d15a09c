"""Monte Carlo: a scenario many times, spread over workers, kept on disk.

engine          runs of a scenario in closed loop
recorder        what the loop leaves behind, collected while it runs
cases           cases, and their runs as workers compute them
store           finished runs on disk
workers         who computes them: processes on this machine, or a Dask cluster
study           cases to results: what is on disk is taken, the rest computed
viewing         a run of a finished study, as `isogal view` shows it
progress        live progress on the standard error stream
"""
