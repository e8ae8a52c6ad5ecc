"""The solid cell problem on any finite element library: load path, averages and their tangents, statuses."""
