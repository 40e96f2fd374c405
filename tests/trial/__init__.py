"""A new user's day in a fresh clone, request by request, on one sheet."""
