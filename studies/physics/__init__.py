"""Computations that studies share: thresholds, limit cycles, branches, onsets, sticks, phases, probabilities."""
