"""Claim of a publication and its check: numbers within a tolerance, statements, verdicts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

from porocore.report.format import number

if TYPE_CHECKING:
    from porocore.commands.reproduce.study import Results

#: ``–``: there is nothing to agree with, such as a time on another machine.
Verdict = Literal["yes", "partly", "no", "–"]
Check: TypeAlias = "Callable[[Results], Finding]"


@dataclass(frozen=True)
class Finding:
    """Computed value or statement for a reader, its agreement with the publication, and the reason or a remark."""

    text: str
    verdict: Verdict = "–"
    why: str = ""


@dataclass(frozen=True)
class Claim:
    """Published number or statement: its section or figure, its words, and its check against the results."""

    where: str
    said: str
    check: Check


class Claims(list[Claim]):
    """Claims of one part in order; a check is written below the claim that it judges."""

    def claim(self, where: str, said: str) -> Callable[[Check], Check]:
        """Return a decorator that appends a claim with the decorated check."""

        def append(check: Check) -> Check:
            self.append(Claim(where, said, check))
            return check

        return append


@dataclass(frozen=True)
class CheckedClaim:
    """A claim beside its finding."""

    where: str
    said: str
    found: str
    verdict: Verdict
    why: str


def check_claims(claims: Sequence[Claim], results: Results) -> list[CheckedClaim]:
    """Check all claims in order."""
    return [CheckedClaim(c.where, c.said, *astuple(c.check(results))) for c in claims]


def compare_number(
    published: float, found: float, tolerance: float, why: str = "", more: str = ""
) -> Finding:
    """A number beside ours; agrees within a relative tolerance."""
    off = found / published - 1
    text = f"{number(found)} ({100 * off:+.1f} %)".replace("-", "−") + more
    return Finding(text, "yes" if abs(off) <= tolerance else "no", why)


def judge_statement(agrees: bool | Verdict, text: str, why: str = "") -> Finding:
    """A statement that holds or not, or in part; the reason counts where it does not hold."""
    verdict: Verdict = agrees if isinstance(agrees, str) else "yes" if agrees else "no"
    return Finding(text, verdict, "" if verdict == "yes" else why)
