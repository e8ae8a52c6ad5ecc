"""Publications recomputed: their figures, and their numbers and statements beside ours."""
