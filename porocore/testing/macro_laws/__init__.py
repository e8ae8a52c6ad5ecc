"""Laws that every macro solver obeys."""
