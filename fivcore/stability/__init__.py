"""Linear stability: `glued` modes, complex modes of steady `sliding`, flutter `onsets`, and `intervals` in theta."""
