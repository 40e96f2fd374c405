"""Studies: figures and tables of the paper, and maps of stability and motion."""
