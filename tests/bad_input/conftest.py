"""The modules of the table are found beside this file."""
