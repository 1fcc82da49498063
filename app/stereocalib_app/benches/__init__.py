"""How quick the pages are, and their pictures; nothing imports this."""
