"""Arithmetic on the results of a whole drive; no pixel."""
