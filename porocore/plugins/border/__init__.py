"""Border to plugins: all that comes out of one is checked once, and the fault names the plugin.

Behind it the core relies on shapes, numbers, statuses and keys.
"""

from porocore.plugins.border.bodies import body_gradients_of, body_sensitivities_of, body_solution_of
from porocore.plugins.border.cells import conductivity_of, solution_of
from porocore.plugins.border.origin import note_origin, origin_of
from porocore.plugins.border.samplers import CheckedSampler
from porocore.plugins.border.surrogates import check_prediction, prediction_of

__all__ = [
    "CheckedSampler",
    "body_gradients_of",
    "body_sensitivities_of",
    "body_solution_of",
    "check_prediction",
    "conductivity_of",
    "note_origin",
    "origin_of",
    "prediction_of",
    "solution_of",
]
