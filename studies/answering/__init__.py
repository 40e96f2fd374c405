"""What a result says: where it is, its summary, the paper's claims and the reference beside it."""
