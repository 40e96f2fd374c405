"""Queries of results: the language of expressions, selection of rows, and their output."""
