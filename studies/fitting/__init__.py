"""Fits: which parameters give what was observed, by weighted draws in rounds."""
