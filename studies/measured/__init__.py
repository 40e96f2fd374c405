"""Measured signals: files of them, and what can be said of one."""
