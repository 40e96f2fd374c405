"""Linear stability: glued modes, complex modes of steady sliding, flutter onsets, curves and windows in theta."""
