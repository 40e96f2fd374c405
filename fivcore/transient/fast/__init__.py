"""`method="fast"`: symmetric impulses and exact moves of a reduced model, second order in the step."""
