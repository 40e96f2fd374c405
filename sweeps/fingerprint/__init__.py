"""What results depend on: code, constants and versions."""
