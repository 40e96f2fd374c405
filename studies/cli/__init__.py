"""The command line: `fiv`."""
