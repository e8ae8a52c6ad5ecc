"""(n) How good the time left is that progress shows: the estimate at a fifth of the time, against what was left.

    python benchmarks/clocks.py OUT.json [CASE …]

Twenty coarse variants of the examples: all kinds of bodies, laws, samplers and surrogates, ramps, bends, cycles, steps of
equal length and steps by their error. Each task that takes at least ``SHORTEST`` seconds counts, unless the progress
shows no estimate at all for it.
"""

from __future__ import annotations

import io
import json
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from porocore.core.console import Console, Task
from porocore.core.inputs.yaml_document import YamlDocument
from porocore.study.config.config import RunConfig
from porocore.study.config.loading import validated
from porocore.study.run_folder.folder import RunFolder
from porocore.study.stages import pipeline
