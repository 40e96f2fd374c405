"""Batches, the loop that runs them, and the back ends it runs them on."""
