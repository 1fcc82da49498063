"""The machine: small text files, caches, compiled code."""
