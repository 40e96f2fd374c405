"""One HTML page of every result."""
