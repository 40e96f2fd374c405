"""Checks of `fiv check`: an installation computes, stores and draws as it should."""

from studies.check.installation import Found, checks, machine

__all__ = ["Found", "checks", "machine"]
