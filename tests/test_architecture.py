"""The shape of the house: which way imports run, what a plugin may use, and what importing costs.

Every module is parsed, so that imports inside functions count too.
"""

import ast
import re
import subprocess
import sys
import textwrap
from functools import cache
from pathlib import Path

import pytest

import porocore

ROOT = Path(__file__).parents[1]
CORE = ROOT / "porocore"
PLUGINS = sorted(path.parent for path in (ROOT / "plugins").glob("*/porocore_*/__init__.py"))

#: From the ground up; a module imports from its own layer and those below. What is not named is in "work".
LAYERS = (
    (
        "foundation",
        (
            "errors",
            "files",
            "reading",
            "unexpected",
            "states",
            "declared_fields",
            "response_check",
            "inputs",
            "possible_states",
            "sampled_range",
            "expressions",
            "expression_domain",
            "echo",
            "bounds",
            "tensors",
            "materials",
            "cell",
            "body",
            "courses",
            "input_file",
            "kinds",
            "dimensions",
            "foreign_mesh",
            "laws",
            "problem",
            "solution",
            "hdf5",
            "parallel",
        ),
    ),
    ("interfaces", ("interfaces",)),
    ("hooks", ("hookspecs",)),
    ("work", ()),
    (
        "choice",
        (
            "plugin_kinds",
            "foreign_code",
            "entry_points",
            "discovery",
            "plugin_table",
            "registry",
            "config",
            "config_sections",
            "workload",
            "backends",
            "schema",
        ),
    ),
    ("run", ("provenance", "run_files", "runfolder")),
    (
        "pipeline",
        (
            "pipeline",
            "solving",
            "stage_files",
            "exploration",
            "preflight",
            "summary",
            "crosscheck",
            "tune",
            "sensitivity",
            "local_fields",
            "verify",
            "reproduce",
            "plugin_check",
            "scaffold",
        ),
    ),
    ("python", ("api",)),
    ("command line", ("cli",)),
)
WORK = [name for name, _ in LAYERS].index("work")
#: What a plugin may import besides ``porocore`` itself, ``porocore.testing`` and the layers below "work".
FOR_PLUGINS = (
    "closures",
    "conductivity",
    "contact",
    "equilibrium",
    "linear",
    "macro",
    "stepping",
    "surrogates",
    "testing",
)
#: Third-party packages that belong to plugins.
OF_PLUGINS = {"skfem", "pyamg", "mkl", "dolfinx", "basix", "ufl", "torch", "jax", "flax"}


def module_name(path, root):
    parts = list(path.relative_to(root).with_suffix("").parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


CORE_MODULES = {module_name(path, ROOT): path for path in sorted(CORE.rglob("*.py"))}


@cache
def imports(path):
    """(module, name or None, line) of every import that runs, wherever it stands."""
    found = []

    def visit(node):
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            for child in node.orelse:
                visit(child)
            return
        if isinstance(node, ast.Import):
            found.extend((alias.name, None, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: a relative import"
            found.extend((node.module, alias.name, node.lineno) for alias in node.names)
        for child in ast.iter_child_nodes(node):
            visit(child)

    visit(ast.parse(path.read_text(encoding="utf-8")))
    return found


def core_imports(path):
    """Modules of the core that a file imports, with lines."""
    for module, name, line in imports(path):
        if module.split(".")[0] == "porocore":
            whole = f"{module}.{name}"
            yield (whole if whole in CORE_MODULES else module), name, line


def layer(module):
    part = module.split(".")[1] if "." in module else ""
    return next((i for i, (_, names) in enumerate(LAYERS) if part in names), WORK)


@pytest.mark.parametrize("module", CORE_MODULES)
def test_the_core_imports_no_plugin_nor_their_packages(module):
    for imported, _, line in imports(CORE_MODULES[module]):
        top = imported.split(".")[0]
        assert not top.startswith("porocore_"), f"{module}:{line} imports {imported}"
        assert top not in OF_PLUGINS, f"{module}:{line} imports {imported}"


@pytest.mark.parametrize("module", [name for name in CORE_MODULES if name != "porocore"])
def test_imports_run_one_way(module):
    for imported, name, line in core_imports(CORE_MODULES[module]):
        # The package itself reaches everywhere, lazily; only the command line asks it, for its version.
        if imported == "porocore":
            assert layer(module) == len(LAYERS) - 1, f"{module}:{line} imports {name} from the package"
            continue
        assert layer(imported) <= layer(module), (
            f"{module}:{line} ({LAYERS[layer(module)][0]}) imports {imported} ({LAYERS[layer(imported)][0]})"
        )


def test_no_module_of_the_core_imports_itself_in_a_circle():
    graph = {
        module: {imported for imported, _, _ in core_imports(path) if imported not in ("porocore", module)}
        for module, path in CORE_MODULES.items()
        if module != "porocore"
    }
    done = set()

    def walk(module, above):
        assert module not in above, " → ".join([*above[above.index(module) :], module])
        if module not in done:
            for imported in graph[module]:
                walk(imported, [*above, module])
            done.add(module)

    for module in graph:
        walk(module, [])


#: Beside the border itself: suites and cases that judge what comes, a study that counts what is not finite, one that
#: times it, and what a surrogate of the core calls of its own.
BEFORE_THE_BORDER = (
    "border",
    "testing",
    "verify",
    "tune",
    "reproduce.calls",
    "surrogates",
    "interfaces",
)


@pytest.mark.parametrize("module", [m for m in CORE_MODULES if not m[9:].startswith(BEFORE_THE_BORDER)])
def test_what_comes_out_of_a_plugin_passes_the_border(module):
    for node in ast.walk(ast.parse(CORE_MODULES[module].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            called, of = node.func.attr, ast.unparse(node.func.value)
            crosses = {
                "predict": True,
                "solve_one": True,
                "ask": of.endswith("sampler") and module != "porocore.sampling.campaign",
                "solve": of.endswith("solver"),
                "conductivity": of.endswith("solver"),
            }
            assert not crosses.get(called, False), (
                f"{module}:{node.lineno} calls {of}.{called}; see porocore.border"
            )


@pytest.mark.parametrize("plugin", PLUGINS, ids=lambda path: path.name)
def test_a_plugin_imports_only_what_is_public(plugin):
    others = {path.name for path in PLUGINS} - {plugin.name}
    for path in sorted(plugin.rglob("*.py")):
        where = path.relative_to(ROOT)
        for imported, _, line in imports(path):
            assert imported.split(".")[0] not in others, f"{where}:{line} imports another plugin, {imported}"
        for imported, name, line in core_imports(path):
            assert not (name or "").startswith("_"), (
                f"{where}:{line} imports the private {name} of {imported}"
            )
            if imported == "porocore":
                assert name is None or name in porocore.__all__, f"{where}:{line}: porocore offers no {name}"
            else:
                part = imported.split(".")[1]
                assert layer(imported) < WORK or part in FOR_PLUGINS, f"{where}:{line} imports {imported}"


@pytest.mark.parametrize("plugin", PLUGINS, ids=lambda path: path.name)
def test_the_hooks_of_a_plugin_are_light(plugin):
    code = f"""
        import sys
        import {plugin.name}.hooks
        print([name for name in ("torch", "skfem", "gmsh", "matplotlib", "scipy") if name in sys.modules])
    """
    assert run_python(code) == "[]"


def test_the_documents_have_these_layers():
    """docs/architecture.md row by row, and both pages with what plugins may use of the layer work."""
    page = (ROOT / "docs/architecture.md").read_text(encoding="utf-8")
    for name, modules in LAYERS:
        row = re.search(rf"^\| {name} \| (.*) \|$", page, re.MULTILINE)
        assert row, f"docs/architecture.md has no row '{name}'"
        if modules:
            assert set(row[1].split(", ")) == set(modules), f"docs/architecture.md, row '{name}'"
    for name in ("architecture", "plugins"):
        page = (ROOT / f"docs/{name}.md").read_text(encoding="utf-8")
        (told,) = re.findall(r"of the layer work, ([^;.]*)[;.]", page)
        assert set(re.findall(r"[a-z]+", told)) - {"and"} >= set(FOR_PLUGINS) - {"testing"}, f"docs/{name}.md"


def test_there_are_plugins_and_modules_to_look_at():
    assert {path.name for path in PLUGINS} >= {"porocore_fem_skfem", "porocore_surrogate_torch"}
    assert {"porocore.states", "porocore.interfaces.cell", "porocore.registry", "porocore.cli.entry"} <= set(
        CORE_MODULES
    )
    named = {name for _, names in LAYERS for name in names} - {"pipeline"}
    assert named <= {module.split(".")[1] for module in CORE_MODULES if "." in module}


def run_python(code):
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


def test_importing_porocore_is_fast_and_light():
    code = """
        import sys, time
        begun = time.perf_counter()
        import porocore
        print(time.perf_counter() - begun)
        print([m for m in ("torch", "gmsh", "matplotlib", "skfem", "numpy", "pydantic", "pint") if m in sys.modules])
    """
    seconds, heavy = run_python(code).splitlines()
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
    assert run_python(code) == "[] []"


def test_what_is_typed_as_public_is_what_is_public():
    tree = ast.parse((CORE / "__init__.py").read_text(encoding="utf-8"))
    typed = {
        (node.module, alias.name)
        for branch in ast.walk(tree)
        if isinstance(branch, ast.If) and ast.unparse(branch.test) == "TYPE_CHECKING"
        for node in branch.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert typed == {(module, name) for module, names in porocore._HOMES.items() for name in names}
    assert sorted(name for _, name in typed) == porocore.__all__
    with pytest.raises(AttributeError, match="no attribute 'frobnicate'"):
        _ = porocore.frobnicate


@pytest.mark.parametrize("module", CORE_MODULES)
def test_only_the_command_line_prints_or_exits_and_nothing_is_unpickled(module):
    speaks = module.startswith("porocore.cli") or module == "porocore.console"
    for node in ast.walk(ast.parse(CORE_MODULES[module].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call) and not speaks:
            called = ast.unparse(node.func)
            assert called not in ("print", "exit", "quit", "sys.exit"), f"{module}:{node.lineno}"
            # A worker process that has lost its parent may end itself, and the copy of a process that tries a file.
            ends = module in ("porocore.execution.processes", "porocore.hdf5.trial")
            assert called != "os._exit" or ends, f"{module}:{node.lineno}"
        if isinstance(node, ast.keyword) and node.arg == "allow_pickle":
            assert ast.unparse(node.value) == "False", f"{module}:{node.lineno}"
    assert not {imported for imported, _, _ in imports(CORE_MODULES[module])} & {
        "pickle",
        "shelve",
        "marshal",
    }
