"""Growth rates over inclination and friction."""
