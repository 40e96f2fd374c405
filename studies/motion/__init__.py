"""Physics that studies share: runs of scenes and what they say, stability of steady sliding, uncertain rigs."""
