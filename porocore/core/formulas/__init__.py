"""Formulas of users, read without executing anything: numbers, functions of time and of place."""
