"""Laws that every surrogate obeys."""
