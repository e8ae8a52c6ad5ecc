"""Commands run in this process, and the examples."""

from pathlib import Path

from typer.testing import CliRunner

from porocore.cli.entry import app
from porocore.errors import ConfigurationError

EXAMPLES = sorted((Path(__file__).parents[2] / "examples").glob("*.yaml"))
BENCHMARK = Path(__file__).parents[2] / "examples" / "dehghani2022.yaml"


def invoke(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


def refusal(*words):
    """The one message of a command that refuses."""
    done = invoke(*words)
    assert isinstance(done.exception, ConfigurationError), done.output
    assert done.stdout == ""
    return str(done.exception)
