"""Run time against error: all methods and settings at the same scenes."""
