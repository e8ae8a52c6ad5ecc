"""A publication recomputed: its figures, numbers and statements beside ours."""
