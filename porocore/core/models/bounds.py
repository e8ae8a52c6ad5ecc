"""Bounds on numbers of a configuration: most states, elements, workers; largest number and seed."""

from __future__ import annotations

#: States of one sampling, and held-out ones.
MOST_STATES = 1_000_000
#: Time steps of one macro run; increments, profile times, corners of a time function.
MOST_STEPS, MOST_TIMES = 100_000, 10_000
#: Elements of a structured body.
MOST_ELEMENTS = 100_000
#: Processes of one machine.
MOST_WORKERS = 512
#: Of one component of H, and of p over Young's modulus of the stiffest solid: far beyond what any cell bears.
LARGEST_GRADIENT, LARGEST_PRESSURE = 10.0, 100.0
#: States of one line of loads, and lines.
MOST_POINTS, MOST_LINES = 10_000, 1000
#: Width of an interval in which something is found by bisection.
SMALLEST_INTERVAL = 1e-9
#: Any other number, so that squares and products of several stay finite.
LARGEST_NUMBER = 1e50
#: Seeds that every generator of random numbers takes.
LARGEST_SEED = 2**31 - 1
