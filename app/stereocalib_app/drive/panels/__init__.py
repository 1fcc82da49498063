"""The parts of the page: each builds its elements once and is told of every tick."""
