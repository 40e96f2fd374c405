"""Figs. 8 to 10: the contact in time."""
