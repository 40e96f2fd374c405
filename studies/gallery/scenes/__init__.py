"""Any grid of transients."""
