"""What the time line can draw: rows of signals over the frames, one file a kind, listed in `table.py`."""
