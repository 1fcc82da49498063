"""What every page shares: browsers, the clock, security."""
