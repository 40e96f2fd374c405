"""From a request to points, from points to a sweep, and from each batch to a call of the study's function."""
