"""The paper, reproduced: its tables and figures from simulation, beside its own values and what it
says about them."""
