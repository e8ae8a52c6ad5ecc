"""What differs between the projects of the four kinds of plugins."""

from __future__ import annotations

from dataclasses import dataclass

from porocore.plugins.hookspecs import Kind


@dataclass(frozen=True)
class Template:
    """Words and names of one kind.

    Attributes
    ----------
    kind
        In words.
    module
        The module with the implementation, and its template.
    suffix
        Of the class.
    hook, requires
        See :mod:`porocore.plugins.hookspecs`.
    prefix
        Of the distribution after ``porocore-``.
    title, about
        What it is, and what it does.
    usage
        How a configuration chooses it, with ``{name}``.
    dependencies
        Beside porocore and numpy.
    """

    kind: Kind
    module: str
    suffix: str
    hook: str
    prefix: str
    title: str
    about: str
    usage: str
    dependencies: tuple[str, ...] = ()

    @property
    def requires(self) -> str:
        """The module by which a missing dependency is noticed."""
        return self.dependencies[0].partition(">")[0] if self.dependencies else "numpy"


TEMPLATES = {
    "cell": Template(
        "cell solver",
        "cell_solver",
        "CellSolver",
        "porocore_cell_solvers",
        "cell",
        "A cell solver",
        "the estimate of Mori and Tanaka for round pores, in closed form",
        "fem:\n  backend: {name}\n  options: {{grain: 0.2}}\nmacro:\n  backend: skfem",
    ),
    "macro": Template(
        "macro solver",
        "macro_solver",
        "MacroSolver",
        "porocore_macro_solvers",
        "macro",
        "A macro solver",
        "finite elements with numpy and scipy alone",
        "macro:\n  backend: {name}",
        ("scipy>=1.11",),
    ),
    "surrogate": Template(
        "surrogate",
        "surrogate",
        "Surrogate",
        "porocore_surrogates",
        "surrogate",
        "A surrogate",
        "a polynomial for <∇u¹>, fitted by least squares",
        "closure: mean-gradient\nsurrogate:\n  backend: {name}\n  options: {{degree: 5}}",
    ),
    "sampler": Template(
        "sampler",
        "sampler",
        "Sampler",
        "porocore_samplers",
        "sampler",
        "A sampler",
        "a grid of states in the box of the inputs",
        "sampling:\n  sampler: {name}\n  options: {{points: 5}}\n  inputs:\n    H22: {{range: [-0.12, 0.02]}}\n"
        "    p: {{range: [-0.02, 0.1]}}",
    ),
}
