"""Declarations: parameters of studies, the syntax of their values, units and labels."""
