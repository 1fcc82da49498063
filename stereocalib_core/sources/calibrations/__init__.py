"""Calibrations that come beside pictures."""
