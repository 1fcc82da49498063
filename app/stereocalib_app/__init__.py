"""The viser app and the command line. No maths here."""
