"""Checks of a study before its first solve."""
