"""What studies ask of several motions: thresholds, loops, limit cycles and their branches, sticks, phases."""
