"""Dimensions and units: texts with units become numbers, and dimensionless results become SI values."""
