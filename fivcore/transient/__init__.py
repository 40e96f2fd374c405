"""Motion in time: three methods with a common interface, observers, and the summary."""
