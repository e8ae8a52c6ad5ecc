"""Fields of a batch of rows: declared once, and checked against their declaration."""
