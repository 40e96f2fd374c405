"""The plan of a sweep: everything that is decided before the first computation."""
