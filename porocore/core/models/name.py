"""Name that a user gives to a part of a study (Name), which reports, tables and files show."""

from __future__ import annotations

from typing import Annotated
from unicodedata import category

from pydantic import AfterValidator

from porocore.core.echo import echo

#: Characters of a name at most.
LONGEST = 200
#: Categories of Unicode of control characters, halves of characters, and ends of lines and paragraphs.
_UNSEEN = ("Cc", "Cs", "Zl", "Zp")


def _named(text: str) -> str:
    if not text.strip():
        raise ValueError(f"expected a name, got {echo(text)}; give it one letter at least")
    if len(text) > LONGEST:
        raise ValueError(f"expected a name of at most {LONGEST} characters, got {len(text)}; shorten it")
    if any(category(c) in _UNSEEN for c in text):
        raise ValueError(
            f"expected a name without line breaks and control characters, got {echo(text)}; leave them out"
        )
    return text


Name = Annotated[str, AfterValidator(_named)]
