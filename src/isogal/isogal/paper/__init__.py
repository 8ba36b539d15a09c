"""The paper, reproduced: its tables, figures and claims from simulation, beside its own values.

============  ==========================================================================
study         The whole reproduction: cases through the workers, then measures and page
cases         Which scenarios do the tables and figures need?
published     What does the paper publish?
measure       What is kept of the runs of a case: errors, spread, tracks
iterations    How does the paper's matcher go from the navigator's track to its fix?
lookups       Examples of the map look-up
results       All that was measured, in one place
claims        Which of the paper's claims hold?
figures       The paper's figures
tables        The page's tables
document      The page
results_json  All numbers as one document
============  ==========================================================================
"""
