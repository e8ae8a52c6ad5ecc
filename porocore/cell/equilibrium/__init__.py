"""The solid cell problem as far as it does not depend on the finite element library: load path, averages, statuses."""
