"""The paper, reproduced: its tables, figures and claims from simulation, beside its own values.

study           the whole reproduction: cases through the workers, then measures, page, numbers
cases           the scenarios that tables and figures need
published       what the paper publishes: values of its tables and of its text
measure         what is kept of the runs of a case, and all that was measured
iterations      how the paper's matcher goes from the navigator's track to its fix
lookups         examples of the map look-up
claims          which of the paper's claims hold
figures         the paper's figures
tables          the page's tables
document        the page
"""
