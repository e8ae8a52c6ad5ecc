"""References that every page asks to cite: porocore of this version, and the paper whose method it computes."""

from __future__ import annotations

from importlib import metadata

#: As CITATION.cff has it.
PAPER = (
    "H. Dehghani and A. Zilian: Finite strain poro-hyperelasticity: An asymptotic multi-scale ALE-FSI approach "
    "supported by ANNs. Computational Mechanics 71, 695–719 (2023), doi:10.1007/s00466-022-02262-y"
)


def citations() -> tuple[str, str]:
    """Return software and paper, each as an entry of a list of references."""
    return f"The porocore developers: porocore, version {metadata.version('porocore')}", PAPER
