"""Studies at scattered points: drawn from distributions, or the rows of a table."""
