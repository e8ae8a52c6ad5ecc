"""Outline of a run before its first solve: cells at rest, work and its time, states that the body will reach."""
