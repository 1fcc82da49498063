"""A drive from its source to its files; many drives; two runs compared."""
