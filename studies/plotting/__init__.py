"""Layout, colours and axes that figures share."""
