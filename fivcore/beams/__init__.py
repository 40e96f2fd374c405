"""The two separate beams: finite elements (`elements`), `modes` and their free motion."""
