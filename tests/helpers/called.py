"""Functions that tests call in other processes."""

import os
import sys
import time

from porocore.errors import SolveError
from tests.helpers.platform_parts import KILL


def counts(tell, name, count, pause=0.0):
    """Tell the numbers below ``count``; return the name, the process and whether the script runs here."""
    for number in range(count):
        time.sleep(pause)
        tell((name, number))
    return name, os.getpid(), os.environ["OMP_NUM_THREADS"], "script_of_the_user" in sys.modules


def refuses(tell, text):
    raise SolveError(text)


def breaks(tell):
    raise ZeroDivisionError("by nothing")


def dies(tell):
    tell("so far")
    time.sleep(0.2)
    os.kill(os.getpid(), KILL)
