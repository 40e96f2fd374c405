"""The two separate beams: finite `elements`, `modes` with free motion, modes of `similar` rigs by scaling."""
