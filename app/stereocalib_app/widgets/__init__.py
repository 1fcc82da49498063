"""Charts, pictures, tables and cards of any page."""
