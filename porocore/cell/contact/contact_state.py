"""Protocol of the contact state of one iterate."""

from __future__ import annotations

from typing import Protocol

from porocore.cell.contact.forces import Blocks, Forces
from porocore.cell.contact.pairs import ContactPairs


class ContactState(Protocol):
    """Contact at one iterate.

    Attributes
    ----------
    pairs
        Contact pairs; None where they do not depend on the iterate.
    """

    pairs: ContactPairs | None

    @property
    def active(self) -> bool:
        """True where any point of the wall is in contact."""

    @property
    def depth(self) -> float:
        """Largest penetration of the wall."""

    @property
    def forces(self) -> Forces:
        """Energy and first derivatives."""

    def blocks(self, parity: str) -> Blocks:
        """Return the second derivatives for the perturbations of a parity class."""
