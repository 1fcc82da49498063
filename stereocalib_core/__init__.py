"""Estimation of a stereo camera's pose over the road, and everything that follows from it."""

__version__ = "0.1.0"
