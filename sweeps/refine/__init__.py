"""Refinement: the choice of points of a lattice that are computed."""
