"""Notes about a study: what is said of it before its first solve and after its last one, with place and advice."""
