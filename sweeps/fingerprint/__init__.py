"""Fingerprints of sweeps: a run resumes stored results only if their fingerprint equals its own."""
