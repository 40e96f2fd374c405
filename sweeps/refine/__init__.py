"""Which points of a lattice are worth computing."""
