"""The kinds of plugins: who offers them, where a study chooses them, and those that the project itself publishes."""

from __future__ import annotations

from porocore.plugins.hookspecs import Kind

#: The hook that offers each kind.
HOOKS: dict[Kind, str] = {
    "cell solver": "porocore_cell_solvers",
    "macro solver": "porocore_macro_solvers",
    "surrogate": "porocore_surrogates",
    "sampler": "porocore_samplers",
}

#: Where a study says which one it takes.
CHOICES: dict[Kind, str] = {
    "cell solver": "fem.backend or --fem",
    "macro solver": "macro.backend or --macro",
    "surrogate": "surrogate.backend or --surrogate",
    "sampler": "sampling.sampler",
}

#: What the project itself publishes: name → (distribution, kinds).
FIRST_PARTY: dict[str, tuple[str, tuple[Kind, ...]]] = {
    "skfem": ("porocore-fem-skfem", ("cell solver", "macro solver")),
    "dolfinx": ("porocore-fem-dolfinx", ("cell solver", "macro solver")),
    "torch": ("porocore-surrogate-torch", ("surrogate",)),
    "jax": ("porocore-surrogate-jax", ("surrogate",)),
}
