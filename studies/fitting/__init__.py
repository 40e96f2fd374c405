"""Fits of parameters to observations, by rounds of weighted draws."""
