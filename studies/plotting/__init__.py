"""Layout, colours and axes that all figures share."""
