"""A number or a statement of a publication, and how it compares with what was computed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from porocore.report.format import number

if TYPE_CHECKING:
    from porocore.verification.reproduce.study import Results

#: ``–``: there is nothing to agree with, such as a time on another machine.
Verdict = Literal["yes", "partly", "no", "–"]


@dataclass(frozen=True)
class Finding:
    """Computed value or statement with its verdict.

    Attributes
    ----------
    text
        For a reader, numbers included.
    verdict
        Agreement with the publication.
    why
        Reason of a disagreement, or what is known of it.
    """

    text: str
    verdict: Verdict
    why: str = ""


@dataclass(frozen=True)
class Claim:
    """Published number or statement with its check.

    Attributes
    ----------
    where
        Section or figure of the publication.
    said
        The number or the statement.
    check
        Computes it from the results.
    """

    where: str
    said: str
    check: Callable[[Results], Finding]


@dataclass(frozen=True)
class CheckedClaim:
    """A claim beside its finding."""

    where: str
    said: str
    found: str
    verdict: Verdict
    why: str


def check_claims(claims: tuple[Claim, ...], results: Results) -> list[CheckedClaim]:
    """Check all claims in order."""
    made = []
    for claim in claims:
        finding = claim.check(results)
        made.append(CheckedClaim(claim.where, claim.said, finding.text, finding.verdict, finding.why))
    return made


def compare_number(
    published: float, found: float, tolerance: float, why: str = "", more: str = ""
) -> Finding:
    """A number beside ours; agrees within a relative tolerance."""
    off = found / published - 1
    text = f"{number(found)} ({100 * off:+.1f} %)".replace("-", "−") + more
    return Finding(text, "yes" if abs(off) <= tolerance else "no", why)


def judge_statement(holds: bool, text: str, why: str = "") -> Finding:
    """A statement that holds or does not."""
    return Finding(text, "yes" if holds else "no", "" if holds else why)
