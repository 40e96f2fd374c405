"""The two beams taken apart: finite elements, modes, and free motion of a mode."""
