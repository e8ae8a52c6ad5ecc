"""The configuration of a study: models, reading, errors with file and line, schema."""
