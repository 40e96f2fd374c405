"""Instability where the numbers of the rig scatter."""
