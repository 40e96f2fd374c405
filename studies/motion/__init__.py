"""Runs of scenes and their statistics, stability of steady sliding, and uncertain rigs, as studies share them."""
