"""Speeds as ratios to a yardstick; nothing imports this."""
