"""Notes on lengths and times of a study that do not suit one another, most often since a unit was left out."""
