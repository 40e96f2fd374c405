"""The contact of the reduced model, its element, its law and one step of it as a matrix."""
