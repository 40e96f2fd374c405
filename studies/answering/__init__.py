"""Results: their files, their summary, and the paper's claims and the reference beside them."""
