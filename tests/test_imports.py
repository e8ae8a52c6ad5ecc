"""What is asked first and most often imports nothing heavy, whatever is installed."""

import subprocess
import sys
import textwrap

import pytest

HEAVY = {
    *("torch", "jax", "dolfinx", "petsc4py", "mpi4py", "skfem", "pyamg", "mkl"),
    *(
        "matplotlib",
        "gmsh",
        "meshio",
        "pyvista",
        "vtkmodules",
        "sympy",
        "pint",
        "jinja2",
        "xarray",
        "distributed",
    ),
    *("scipy.optimize", "scipy.sparse", "scipy.interpolate", "pytest"),
}
COMMAND = "import sys; sys.argv = ['porocore', {}]; from porocore.cli import main; main()"


def loaded(code: str) -> set[str]:
    """Modules that are there when a process with this code ends, its own standard output left out."""
    words = f"import atexit, sys\natexit.register(lambda: print(*sys.modules, file=sys.stderr))\n{code}"
    done = subprocess.run([sys.executable, "-c", words], capture_output=True, text=True, check=True)
    return set(done.stderr.split())


@pytest.mark.parametrize(
    ("code", "too_much"),
    [
        (
            "import porocore",
            {*HEAVY, "numpy", "scipy", "h5py", "pydantic", "typer", "rich", "yaml", "pluggy"},
        ),
        (
            "import porocore; [getattr(porocore, name) for name in porocore.__all__]",
            HEAVY - {"scipy.sparse"} | {"scipy.stats"},
        ),
        # The commands of plugins are found by their hooks.
        (COMMAND.format("'--help'"), {*HEAVY, "numpy", "scipy", "h5py", "pydantic"}),
        # Some versions of typer look whether pydantic is there.
        (COMMAND.format("'run', '--help'"), {*HEAVY, "numpy", "scipy", "h5py", "pluggy"}),
        (COMMAND.format("'--version'"), {*HEAVY, "numpy", "scipy", "h5py", "pydantic", "pluggy"}),
        (COMMAND.format("'plugins'"), HEAVY),
        (COMMAND.format("'plugins', '--json'"), HEAVY),
        (COMMAND.format("'units', 'time=1'"), HEAVY - {"pint"}),
    ],
    ids=["import", "everything", "--help", "run --help", "--version", "plugins", "plugins --json", "units"],
)
def test_a_light_command_loads_no_heavy_library(code, too_much):
    found = loaded(code)
    assert "porocore" in found
    assert not too_much & found


def test_a_heavy_import_would_be_seen():
    assert {"pint", "porocore"} <= loaded("import porocore, pint")


def printed(code: str) -> str:
    """Standard output of a process with this code."""
    words = [sys.executable, "-c", textwrap.dedent(code)]
    return subprocess.run(words, capture_output=True, text=True, check=True).stdout.strip()


def test_importing_porocore_is_fast_and_light():
    code = """
        import sys, time
        begun = time.process_time()
        import porocore
        print(time.process_time() - begun)
        print([m for m in ("torch", "gmsh", "matplotlib", "skfem", "numpy", "pydantic", "pint") if m in sys.modules])
    """
    seconds, heavy = printed(code).splitlines()
    assert float(seconds) < 0.1
    assert heavy == "[]"


def test_everything_public_resolves_without_a_heavy_import():
    code = """
        import sys
        import porocore
        missing = [name for name in porocore.__all__ if getattr(porocore, name, None) is None]
        heavy = ("torch", "gmsh", "matplotlib", "skfem", "pyamg", "pint", "xarray", "pyvista")
        print(missing, [m for m in heavy if m in sys.modules])
    """
    assert printed(code) == "[] []"
