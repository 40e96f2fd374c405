"""Motion in time: three methods of one shape, what is observed of them, and the summary."""
