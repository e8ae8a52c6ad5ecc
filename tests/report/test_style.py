"""The style of figures, whatever the reader's own settings of matplotlib are."""

import os
import subprocess
import sys

DRAW = """
from porocore.core.console import quieten_libraries
quieten_libraries()
import hashlib
from porocore.report.figures.style import new_figure, styled, svg_bytes

@styled
def draw():
    figure = new_figure(3.0, 2.0)
    axes = figure.add_subplot()
    axes.plot([0, 1], [0, 1], label="a line")
    axes.set_title("a title")
    axes.legend()
    return svg_bytes(figure)

print(hashlib.sha256(draw()).hexdigest())
"""


def drawn(folder, **environment):
    """What a process prints that draws a figure in a folder; nothing may be said beside it."""
    done = subprocess.run(
        [sys.executable, "-c", DRAW], cwd=folder, env={**os.environ, **environment}, capture_output=True
    )
    assert (done.returncode, done.stderr.decode()) == (0, "")
    return done.stdout


SETTINGS = """
text.usetex: True
font.size: 30
axes.titleweight: bold
legend.loc: lower left
no.such.key: 3
"""


def test_the_readers_matplotlibrc_does_not_reach_our_figures(tmp_path):
    """LaTeX, which the machine may lack, was asked for; a bold title stood in the report."""
    plain = tmp_path / "plain"
    plain.mkdir()
    (tmp_path / "matplotlibrc").write_text(SETTINGS)
    assert drawn(tmp_path) == drawn(plain)


def test_a_home_that_cannot_be_written_is_no_matter(tmp_path):
    """Two lines of matplotlib stood amid the messages of a run."""
    (tmp_path / "home").write_text("a file")
    names = dict.fromkeys(("MPLCONFIGDIR", "XDG_CONFIG_HOME", "XDG_CACHE_HOME"), "")
    drawn(tmp_path, HOME=str(tmp_path / "home"), **names)
