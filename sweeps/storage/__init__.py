"""Files of a sweep: parts during a run, one netCDF file at its end."""
