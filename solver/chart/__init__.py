"""Charts: what the solver is measured against."""
