"""Motion in time: three methods, what is counted while they run, and the summary."""
