"""Fingerprint of a sweep: a run resumes stored results only if their fingerprint is its own."""
