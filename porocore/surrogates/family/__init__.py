"""The potential W(ln U, p; θ) of a family of cells: coordinates of θ, exact rest for every θ, polynomials."""
