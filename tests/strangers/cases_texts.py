"""Configurations whose text is not what its writer meant."""

from __future__ import annotations

from stranger_case import Case

CASES: list[Case] = []
