"""Version of the conformance kit, and the complaint about a suite that pins another one.

The first number is raised when a law is added or sharpened, so that a plugin that passed may fail; the second when
suites gain something that no passing plugin can notice.
"""

from __future__ import annotations

KIT_VERSION = "3.0"


def complaint(pinned: str) -> str:
    """Return why a suite that pins ``pinned`` does not fit this kit, and what to do; empty if it fits."""
    major = KIT_VERSION.partition(".")[0]
    if not pinned:
        return f'pins no version of the kit; write kit_version = "{major}" in the class'
    wanted, _, minor = pinned.partition(".") if isinstance(pinned, str) else ("", "", "")
    numbers = (wanted, minor or "0")
    if not all(number.isdecimal() for number in numbers):
        return f'kit_version: expected a text such as "{major}" or "{KIT_VERSION}", got {pinned!r}'
    here = tuple(map(int, KIT_VERSION.split(".")))
    asked = tuple(map(int, numbers))
    if asked[0] < here[0]:
        return (
            f"was made for version {pinned} of the kit, and this porocore has {KIT_VERSION}, with sharper laws; "
            f'see which of them fail below, mend them, and write kit_version = "{major}"'
        )
    if asked > here:
        return (
            f"was made for version {pinned} of the kit, and this porocore has {KIT_VERSION}; "
            "install a newer one: pip install --upgrade porocore"
        )
    return ""
