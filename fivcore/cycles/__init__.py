"""Limit cycles of stick, slip and separation: shooting from event to event, first guesses, and continuation."""
