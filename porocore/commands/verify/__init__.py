"""Verification: cases with known solutions, solved by every installed finite-element backend."""
