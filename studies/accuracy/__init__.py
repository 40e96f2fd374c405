"""Run time against error: every method and setting on the same scenes."""
