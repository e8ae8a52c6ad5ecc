"""Projects for authors of plugins, written by ``porocore plugin new``."""
