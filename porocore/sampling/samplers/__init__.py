"""Samplers: density sweep, designs, lines, and those that learn."""
