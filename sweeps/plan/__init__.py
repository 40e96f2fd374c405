"""The plan of a sweep: all decisions before the first computation."""
