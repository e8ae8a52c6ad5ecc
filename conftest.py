"""Options of the test suite, and how its tests are shared among workers."""

import signal

import pytest

# A shell that starts the tests in the background has Ctrl-C ignored, and so it would be in all that tests start.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

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
        "plugins/fem_dolfinx/tests/test_macro_mpi.py",
    ),
}
#: Begun first, so that no worker is left with a long one at the end.
LONG = ("jax", "finished run", "tests/docs/test_snippets", "plugins/", "tests/consistency/", "tests/e2e/")


def pytest_addoption(parser):
    parser.addoption("--run-slow", action="store_true", help="also run the tests marked slow")


def pytest_collection_modifyitems(config, items):
    if config.getoption("--run-slow"):
        return
    skip = pytest.mark.skip(reason="slow; run with --run-slow")
    for item in items:
        if "slow" in item.keywords:
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
