"""Fingerprint of a sweep: stored results are taken up only where it equals theirs.

`code` reads which code a function reaches, `identity` adds the declaration, `provenance` records versions.
"""
