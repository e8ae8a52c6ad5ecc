"""A material of every kind, and deformation gradients at which they are looked at."""

import numpy as np
from pydantic import TypeAdapter
from scipy.spatial.transform import Rotation

from porocore.cell.materials.hyperelastic import AnyMaterial

make = TypeAdapter(AnyMaterial).validate_python
NU = 0.35
MU, LAM = 1 / (2 * (1 + NU)), NU / ((1 + NU) * (1 - 2 * NU))
FIBRES = "c*(I1*I3**(-1/3) - 3) + k*(J - 1)**2/2 + f*(I4 - 1)**2 + g*(I5 - 1)**2*I2 + h*(I6 - 1)**2*I4*I7"
MATERIALS = {
    "neo-hookean": make({"poisson_ratio": NU}),
    "mooney-rivlin": make({"kind": "mooney-rivlin", "c10": 0.15, "c01": 0.03, "bulk_modulus": 1.1}),
    "ogden": make(
        {
            "kind": "ogden",
            "terms": [{"mu": 0.3, "alpha": 2.3}, {"mu": -0.05, "alpha": -1.7}, {"mu": 0.01, "alpha": 8}],
            "bulk_modulus": 1.0,
        }
    ),
    "holzapfel-gasser-ogden": make(
        {
            "kind": "holzapfel-gasser-ogden",
            "shear_modulus": 0.3,
            "bulk_modulus": 1.0,
            "k1": 0.5,
            "k2": 2.0,
            "dispersion": 0.1,
            "directions": [[1, 1, 0], [1, -1, 0]],
        }
    ),
    "expression": make(
        {
            "kind": "expression",
            "energy": "mu/2*(I1 - 3) - mu*log(J) + lam/2*log(J)**2",
            "parameters": {"mu": MU, "lam": LAM},
        }
    ),
    "expression with fibres": make(
        {
            "kind": "expression",
            "energy": FIBRES,
            "parameters": {"c": 0.2, "k": 1.0, "f": 0.3, "g": 0.1, "h": 0.2},
            "directions": [[1, 2, 0], [0, 0, 3]],
        }
    ),
}


def deformations():
    """Deformation gradients (27, 3, 3) up to strains of 0.5; the last ones have equal or nearly equal stretches."""
    rng = np.random.default_rng(3)
    F = np.eye(3) + 0.2 * rng.normal(size=(60, 3, 3))
    R = Rotation.from_rotvec([0.3, -0.8, 0.4]).as_matrix()
    stretches = (
        (1, 1, 1),
        (1.3, 1.3, 0.7),
        (0.8, 0.8, 0.8),
        (1.2, 1.2 + 1e-9, 0.9),
        (1.2, 1.2 - 1e-7, 1.2 + 1e-7),
    )
    near = [R @ np.diag(s) @ Rotation.from_rotvec([1.0, 0.2, k]).as_matrix() for k, s in enumerate(stretches)]
    return np.concatenate([F[np.linalg.det(F) > 0.4][:22], near])
