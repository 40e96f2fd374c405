"""Parts that structures are made of."""
