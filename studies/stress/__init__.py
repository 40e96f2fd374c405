"""What breaks a method, and what does not."""
