"""Bounds on what a configuration may ask for: beyond them it is a slip of the pen, and no machine would finish."""

from __future__ import annotations

#: States of one sampling, and held-out ones.
MOST_STATES = 1_000_000
#: Time steps of one macro run; increments, profile times, corners of a course.
MOST_STEPS, MOST_TIMES = 100_000, 10_000
#: Elements of a structured body.
MOST_ELEMENTS = 100_000
#: Processes of one machine.
MOST_WORKERS = 512
#: Of one component of H, and of p over the reference modulus: far beyond what any cell bears.
LARGEST_GRADIENT, LARGEST_PRESSURE = 100.0, 1e4
#: Any other number, so that squares and products of several stay finite.
LARGEST_NUMBER = 1e50
#: Seeds that every generator of random numbers takes.
LARGEST_SEED = 2**31 - 1
