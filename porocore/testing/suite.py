"""Base of all suites (Suite): version of the kit that a plugin pins, checks that it breaks knowingly."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import pytest

from porocore.core.echo import did_you_mean
from porocore.plugins.table import KIT_VERSION, complaint
from porocore.testing.expect import Undefined, as_violation, holds


class Suite:
    """Checks of one interface; a plugin subclasses it as ``class TestMine(…)`` and says what is to be tested.

    Attributes
    ----------
    kit_version
        The version of the kit that the plugin passes, such as ``"2"``. With another one a single check fails and says
        what to do.
    expected_failures
        Checks that the implementation is known to break: name of the test → reason. A name without brackets holds for
        all cases of the check. They are reported as expected failures, and fail if they pass.
    """

    kit_version: ClassVar[str] = ""
    #: ``module:function`` and its arguments, which make the suite in another process; empty: it is a class of a module.
    recipe: ClassVar[tuple[str, ...]] = ()
    expected_failures: ClassVar[Mapping[str, str]] = {}

    def __init_subclass__(cls, **more: Any) -> None:
        super().__init_subclass__(**more)
        for name, check in list(vars(cls).items()):
            if name.startswith("test_") and callable(check):
                setattr(cls, name, as_violation(check))
        for name, reason in cls.expected_failures.items():
            check = name.partition("[")[0]
            if not callable(getattr(cls, check, None)):
                advice = did_you_mean(check, checks_of(cls)) or "see the checks of its base class"
                raise TypeError(f"{cls.__name__}.expected_failures: there is no check '{check}'; {advice}")
            if not isinstance(reason, str) or not reason.strip():
                raise TypeError(
                    f"{cls.__name__}.expected_failures['{name}']: expected a reason, got {reason!r}"
                )

    @classmethod
    def undefined(cls, arguments: str, example: str, what: str) -> Undefined:
        """Return the error for a subclass without a function that it must define, such as ``make_solver(cls)``.

        ``example`` is what it may return, and ``what`` says so in words.
        """
        return Undefined(
            f"{cls.__name__} does not say what is tested; write in it a function that returns {what}:\n\n"
            f"    @classmethod\n    def {arguments}:\n        return {example}\n"
        )

    @staticmethod
    def needs(offered: bool, what: str) -> None:
        """Skip the check where the implementation declares not to offer what it tests; ``what`` says so."""
        if not offered:
            pytest.skip(what)

    @pytest.fixture(autouse=True)
    def _expect_failures(self, request: pytest.FixtureRequest) -> None:
        """Mark the checks that are known to be broken."""
        item: Any = request.node
        for name in (item.name, item.originalname):
            if name in self.expected_failures:
                request.applymarker(pytest.mark.xfail(reason=self.expected_failures[name], strict=True))
                return

    def test_version_of_the_kit(self) -> None:
        """The suite was written for the kit that is installed."""
        wrong = complaint(self.kit_version)
        state = f"{type(self).__name__}.kit_version = {self.kit_version!r}"
        holds(not wrong, state, f"a suite for version {KIT_VERSION} of the kit", f"one that {wrong}")


def checks_of(suite: type[Suite]) -> list[str]:
    """Names of the tests of a suite."""
    return sorted(name for name in dir(suite) if name.startswith("test_") and callable(getattr(suite, name)))
