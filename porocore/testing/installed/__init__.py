"""The kit against an installed plugin, in a process of its own."""
