"""How well a run knows its statistics: sums over blocks of samples, and standard errors."""
