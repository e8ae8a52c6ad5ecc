"""The samplers: density sweep, designs, lines, and those that learn while they sample."""
