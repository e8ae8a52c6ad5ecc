"""What every other room speaks: inputs, formulas, units, files, tensors, messages. It imports no other room."""
