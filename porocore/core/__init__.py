"""Inputs, formulas, units, files, tensors and messages, which all rooms use. It imports no other room."""
