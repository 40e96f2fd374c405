"""The contact of the reduced model: what it keeps, its law, when the law has one answer, one step as a map."""
