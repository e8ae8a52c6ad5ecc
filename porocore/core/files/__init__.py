"""Files that are written whole or not at all, and read with one clear message when they are at fault."""
