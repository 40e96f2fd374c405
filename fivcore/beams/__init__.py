"""The two separate beams: finite elements (`elements`), `modes`, and free motion of modes (`free_motion`)."""
