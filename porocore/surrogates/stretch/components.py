"""Order of the six components of a symmetric tensor, their places and shares."""

from __future__ import annotations

import numpy as np

#: Places of the six components.
PLACES = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
#: Component at each of the nine places.
COMPONENT = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])
#: A derivative with respect to a component, shared among its places.
SHARE = np.array([1.0, 1.0, 1.0, 0.5, 0.5, 0.5])
#: Two different axes, and where a shear between them stands among the six.
PAIRS = ((1, 2, 3), (0, 2, 4), (0, 1, 5))
