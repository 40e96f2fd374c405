"""What a sweep will do, decided before the first computation."""
