"""Laws that every sampler obeys."""
