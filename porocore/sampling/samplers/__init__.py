"""Samplers: density sweep, designs, those that learn, random states."""
