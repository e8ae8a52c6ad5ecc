"""What every model says of contact at one iterate."""

from __future__ import annotations

from typing import Protocol

from porocore.cell.contact.forces import Blocks, Forces


class ContactState(Protocol):
    """Contact at one iterate."""

    @property
    def active(self) -> bool:
        """Whether anything touches."""

    @property
    def depth(self) -> float:
        """Of the deepest penetration."""

    @property
    def forces(self) -> Forces:
        """Energy and first derivatives."""

    def blocks(self, parity: str) -> Blocks:
        """Second derivatives for perturbations that are odd under the mirrors of the named axes."""
