"""Results: their files, their summaries, and their comparison with the paper and the reference."""
