"""Linear stability: the glued rig, modes of steady sliding, flutter onsets, windows of inclination."""
