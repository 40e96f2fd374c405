"""Linear stability: `glued` modes, modes of steady `sliding`, flutter `onsets` and their `intervals` in theta."""
