"""A state is given in one way, by ``--at`` or by ``--grad-u`` and ``--p``, wherever a command solves one."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest

from porocore.cli import main
from porocore.cli.states import parse_grad_u, read_state
from porocore.errors import ConfigurationError
from porocore.states import Status
from porocore.study import run as stages
from porocore.study.config.loading import benchmark_path


@pytest.fixture
def asked(monkeypatch, capsys):
    """Give the state that ``cell COMMAND WORDS`` solves as ten numbers, or its message on standard error."""
    seen = []

    def state(config, grad_u, p, **how):
        seen.append([*np.ravel(grad_u), p])
        return {"status": "converged"}

    def fields(config, folder, state, *, name=None, pictures=True, **how):
        from porocore.core.inputs import NAMES

        seen.append([state.get(name, 0.0) for name in NAMES])
        response = SimpleNamespace(status=[Status.converged], extrema=None)
        return SimpleNamespace(response=response, vtu="fields.vtu", pictures={})

    monkeypatch.setattr(stages, "pipeline", SimpleNamespace(solve_cell=state), raising=False)
    monkeypatch.setattr("porocore.commands.fields.solve.write_local_fields", fields)

    def run(command, *words):
        seen.clear()
        monkeypatch.setattr(sys, "argv", ["porocore", "cell", command, str(benchmark_path()), *words])
        with pytest.raises(SystemExit) as ended:
            main()
        if ended.value.code:
            assert (ended.value.code, seen) == (2, [])
            return capsys.readouterr().err
        return np.array(seen[0])

    return run


PRESSED = [0, 0, 0, 0, -0.1, 0, 0, 0, 0, 0.05]


@pytest.mark.parametrize("command", ["state", "fields"])
@pytest.mark.parametrize(
    "words",
    [
        ("--at", "H22=-0.1,p=0.05"),
        ("--at", "H22=-0.1", "--at", "p=0.05"),
        ("--at", "p = 0.05, H22 = -0.1, H11 = 0"),
        ("--at", "H22=-0.1", "--p", "0.05"),
        ("--grad-u", "0 0 0; 0 -0.1 0; 0 0 0", "--p", "0.05"),
        ("--grad-u", "0,0,0; 0,-1e-1,0; 0,0,0", "--at", "p=5e-2"),
    ],
)
def test_both_commands_take_a_state_in_every_form(asked, command, words):
    np.testing.assert_array_equal(asked(command, *words), PRESSED)


def test_without_a_state_each_has_its_usual_one(asked):
    np.testing.assert_array_equal(asked("state"), np.zeros(10))
    np.testing.assert_array_equal(asked("fields"), [0, 0, 0, 0, -0.1, 0, 0, 0, 0, 0])
    np.testing.assert_array_equal(asked("fields", "--p", "0.1"), [0] * 9 + [0.1])


@pytest.mark.parametrize("command", ["state", "fields"])
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--at", "H44=1"), "--at: expected finite values of some of H11, H12, H13,"),
        (("--at", "h22=-0.1"), "got h22 = -0.1; did you mean 'H22'?"),
        (
            ("--at", "H22=-0.1", "--grad-u", "0 0 0; 0 0 0; 0 0 0"),
            "--grad-u: --at gives H22, too; leave out one",
        ),
        (("--at", "p=0.1", "--p", "0.1"), "--p: --at gives p, too; leave out one of the two"),
        (("--at", "H22=-1"), "--at: det F = 0 with F = I + H"),
        (("--grad-u", "0 0 0; 0 -2 0; 0 0 0", "--p", "0"), "--grad-u and --p: det F = -1"),
        (("--p", "nan"), "--p: expected a finite number, got nan"),
        (("--grad-u", "nan"), "--grad-u: expected nine finite numbers as 'a b c; d e f; g h i', got 'nan'"),
    ],
)
def test_what_is_no_state_is_refused_with_the_option(asked, command, words, said):
    assert said in asked(command, *words)


def test_the_help_of_the_group_says_how_a_state_is_given(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["porocore", "cell", "--help"])
    with pytest.raises(SystemExit):
        main()
    told = " ".join(capsys.readouterr().out.split())
    for form in ("--at H22=-0.1,p=0.05", '--grad-u "0 0 0; 0 -0.1 0; 0 0 0" --p 0.05'):
        assert form in told


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "rows of 0"),
        ("1 2 3", "rows of 3"),
        ("nan", "rows of 1"),
        ("1 2 3; 4 5 6; 7 8", "rows of 3, 3, 2"),
        ("1 2 3; 4 5 6; 7 8 x", "(not all are numbers)"),
        ("1 2 3; 4 5 6; 7 8 nan", "not all are finite"),
    ],
)
def test_a_malformed_gradient_is_refused(text, why):
    with pytest.raises(ConfigurationError, match=f"expected nine finite numbers .*{why}"):
        parse_grad_u(text)


def test_zeros_are_left_out_of_a_state():
    assert read_state(None, "0 0 0; 0 -0.1 0; 0 0 0", 0.0, 1.0, {}) == {"H22": -0.1}
