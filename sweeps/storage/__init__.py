"""Files of a sweep: parts while it runs, one netCDF file at its end."""
