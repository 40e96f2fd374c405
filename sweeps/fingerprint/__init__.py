"""Fingerprint of a sweep: stored results are taken up only where it equals theirs.

`source` reads modules, `code` follows functions to what they reach, `identity` adds the declaration, `provenance`
records versions.
"""
