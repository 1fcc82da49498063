"""Arithmetic without a word of the domain: robust loops, rotations, small algebra, threads."""
