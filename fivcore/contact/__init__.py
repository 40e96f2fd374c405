"""The contact of the reduced model: kept modes, contact law, uniqueness of the force, and the step as a map."""
