"""What runs achieved: errors, consistency, the bound, figures and reports."""
