"""Linear stability: glued modes, complex modes of steady sliding, flutter onsets, curves and windows in theta."""

from fivcore.stability.glued import glued_frequencies, tune_head_mass
from fivcore.stability.intervals import OnsetCurve, OnsetCurves, UnstableWindows, onset_curves, unstable_windows
from fivcore.stability.onsets import FlutterOnsets, flutter_onsets
from fivcore.stability.sliding import SlidingModes, node_positions, sliding_modes

__all__ = [
    "FlutterOnsets",
    "OnsetCurve",
    "OnsetCurves",
    "SlidingModes",
    "UnstableWindows",
    "flutter_onsets",
    "glued_frequencies",
    "node_positions",
    "onset_curves",
    "sliding_modes",
    "tune_head_mass",
    "unstable_windows",
]
