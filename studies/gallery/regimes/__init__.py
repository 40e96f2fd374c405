"""Kinds of vibration over speed and friction."""
