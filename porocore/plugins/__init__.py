"""Plugins: the hooks, finding what is installed, choosing one by name, and checking what it returns."""
