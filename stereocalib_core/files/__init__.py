"""Drive to bytes and back: every file that a run writes or reads."""
