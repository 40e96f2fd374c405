"""One quantity over any two axes."""
