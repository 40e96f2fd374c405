"""What a study depends on: parameters, how their values are written, and how they are labelled."""
