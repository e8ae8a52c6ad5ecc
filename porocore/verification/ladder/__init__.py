"""A ladder of cases whose answers are known from elsewhere, climbed by every installed finite-element backend."""
