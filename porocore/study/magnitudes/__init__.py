"""Notes on lengths and times that do not suit one another, mostly since a unit was left out."""
