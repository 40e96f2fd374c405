"""Report: one HTML page of all results."""
