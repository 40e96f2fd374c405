"""The contact of the reduced model: residual flexibility, law, and one step as a matrix."""
