"""How well a run knows its statistics: block sums, standard errors, and runs that end when they know enough."""
