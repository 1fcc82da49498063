"""Pixels, once a frame: a stereo frame to its result."""
