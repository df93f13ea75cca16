"""The harness: each file answers one question with a table. They use qparm's public names alone."""
