"""Rows of results: the language of expressions, what it selects, how rows are printed."""
