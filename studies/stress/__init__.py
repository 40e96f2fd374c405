"""A battery of hard cases for every method."""
