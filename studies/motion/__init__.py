"""Scenes simulated for studies: jobs, ensembles, recorded series."""
