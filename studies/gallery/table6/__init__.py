"""Table 6: the inclination."""
