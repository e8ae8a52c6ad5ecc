"""Options of the test suite, and how its tests are shared among workers."""

import os
import signal
import sys
from collections import Counter
from pathlib import Path

import pytest

# A shell that starts the tests in the background has Ctrl-C ignored, and so it would be in all that tests start.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Hundreds of processes are started, each of which would compile every module anew, and pytest every test.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# Every state that a test asks for is solved, and nothing is put into the store of the user.
os.environ["POROCORE_STORE"] = "none"

#: Scopes that share what is expensive to set up, or that must not run side by side: each is done by one worker.
TOGETHER = {
    # Every process in which jax compiles keeps gigabytes; what one test compiles, the next one finds.
    "jax": ("plugins/surrogate_jax/", "tests/consistency/test_surrogate"),
    # Built once, and one environment with gigabytes of libraries for all that look into it.
    "distributions": ("tests/release/",),
    # One finished run for all of them; and on two cores two MPI runs of two processes would wait for one another.
    "finished run": (
        "tests/e2e/test_damaged.py",
        "tests/e2e/test_disks.py",
        "tests/e2e/test_kills.py",
        "tests/e2e/test_mpi.py",
        "tests/e2e/test_physics.py",
        "tests/e2e/test_python.py",
        "tests/e2e/test_refusals.py",
        "tests/e2e/test_run.py",
        "tests/e2e/test_side_by_side.py",
        "plugins/fem_dolfinx/tests/test_macro_mpi.py",
    ),
}
#: Begun first, so that no worker is left with a long one at the end.
LONG = ("jax", "finished run", "tests/docs/test_snippets", "plugins/", "tests/consistency/", "tests/e2e/")


#: Beginnings of the reasons for which a test may be skipped where everything is installed: it is for the slow suite, or
#: the machine lacks what cannot be installed.
GOOD_REASONS = (
    "slow;",
    "torch sees no GPU",
    "a small disk cannot be mounted here",
    "there is no 'unshare' here",
)
#: Words for what this platform cannot have, as in POROCORE_WITHOUT=dolfinx,mpirun: a test whose reason has one of them
#: may be skipped with CI set, too.
WITHOUT = tuple(filter(None, os.environ.get("POROCORE_WITHOUT", "").lower().split(",")))
if sys.platform == "win32":
    GOOD_REASONS += ("POSIX alone", "could not import 'resource'")
#: What an implementation need not offer: reasons from the kit, and from tests that compare what only some offer.
OFFERED_BY_SOME = ("porocore/testing/", "gives no access to its tangent")


#: Beginnings of the names of tests that are slow beside those that are marked so.
SLOW = tuple(
    line
    for line in (Path(__file__).parent / "tests/slow_tests.txt").read_text(encoding="utf-8").splitlines()
    if line and not line.startswith("#")
)


def pytest_addoption(parser):
    parser.addoption("--run-slow", action="store_true", help="also run the tests marked slow")


def pytest_collection_modifyitems(config, items):
    if config.getoption("--run-slow"):
        return
    skip = pytest.mark.skip(reason="slow; run with --run-slow")
    for item in items:
        # Not among the keywords: names of parameters are there too.
        if item.get_closest_marker("slow") or item.nodeid.startswith(SLOW):
            item.add_marker(skip)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """A class, or the functions of a file, stay on one worker, so that no set-up is done twice.

    Not by the marker 'xdist_group': pytest 9 pays no heed to how pytest-xdist 3.8 passes it on.
    """
    if config.getvalue("dist") != "loadscope":
        return None
    from xdist.scheduler import LoadScopeScheduling

    class Scheduling(LoadScopeScheduling):
        def _split_scope(self, nodeid):
            for name, places in TOGETHER.items():
                if nodeid.startswith(places):
                    return name
            return super()._split_scope(nodeid)

        def _assign_work_unit(self, node):
            def rank(scope):
                return next((i for i, start in enumerate(LONG) if scope.startswith(start)), len(LONG))

            self.workqueue.move_to_end(min(self.workqueue, key=rank), last=False)
            super()._assign_work_unit(node)

    return Scheduling(config, log)


def bad_skips(skipped):
    """Reasons, with their numbers, for which (file, line, reason) were skipped though everything is installed."""
    return Counter(
        reason.removeprefix("Skipped: ")
        for file, _, reason in skipped
        if not reason.removeprefix("Skipped: ").startswith(GOOD_REASONS)
        and not any(part in file or part in reason for part in OFFERED_BY_SOME)
        and not any(word in reason.lower() for word in WITHOUT)
    )


def _skipped(config):
    reporter = config.pluginmanager.get_plugin("terminalreporter")
    reports = reporter.stats.get("skipped", []) if reporter else []
    return [report.longrepr for report in reports if isinstance(report.longrepr, tuple)]


@pytest.hookimpl(tryfirst=True)
def pytest_sessionfinish(session, exitstatus):
    """With the variable CI set, a test that is skipped for want of something fails the run."""
    if os.environ.get("CI") and exitstatus == 0 and bad_skips(_skipped(session.config)):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter, config):
    if not os.environ.get("CI"):
        return
    skipped = _skipped(config)
    bad = bad_skips(skipped)
    slow = sum(reason.removeprefix("Skipped: ").startswith("slow;") for *_, reason in skipped)
    terminalreporter.section("skipped")
    terminalreporter.line(
        f"{len(skipped)} skipped: {slow} for the slow suite, {len(skipped) - slow - bad.total()} that an "
        f"implementation does not offer or the machine cannot do, {bad.total()} for want of something, "
        "which is a failure here"
    )
    for reason, count in bad.most_common():
        terminalreporter.line(f"{count}: {reason}")
