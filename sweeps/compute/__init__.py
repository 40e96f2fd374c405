"""The loop over batches, and the executors that compute them."""
