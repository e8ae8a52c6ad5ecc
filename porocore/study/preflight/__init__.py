"""Everything that can be found wrong before the first solve."""
