"""The shape of the house: which way imports run, what a plugin may use and what is public.

Every module is parsed, so that imports inside functions and those for type checkers count too.
"""

import ast
import importlib
import re
import subprocess
import sys
import textwrap
from functools import cache
from pathlib import Path

import pytest

import porocore
import porocore.interfaces
import porocore.testing

ROOT = Path(__file__).parents[1]
CORE = ROOT / "porocore"
PLUGINS = sorted(path.parent for path in (ROOT / "plugins").glob("*/porocore_*/__init__.py"))

#: Modules of the root, which every room may import.
ROOT_MODULES = ("errors", "states")
#: Every room, from the ground up, with the rooms that it may import.
ROOMS = {
    "core": (),
    "interfaces": ("core",),
    "plugins": ("core", "interfaces"),
    "cell": ("core", "interfaces", "plugins"),
    "sampling": ("core", "interfaces", "plugins"),
    "surrogates": ("core", "interfaces", "plugins"),
    "macro": ("core", "interfaces", "plugins", "cell", "sampling"),
    "report": ("core", "interfaces", "cell", "macro"),
    "study": ("core", "interfaces", "plugins", "cell", "sampling", "surrogates", "macro", "report"),
    "testing": ("core", "interfaces", "plugins", "cell", "surrogates", "macro", "study"),
    "cli": ("core", "interfaces", "plugins", "cell", "sampling", "report", "study", "testing"),
    "commands": (
        *("core", "interfaces", "plugins", "cell", "sampling", "macro", "report", "study", "testing", "cli"),
    ),
}
#: Characters of the first line of a module's docstring.
MOST_OF_A_FIRST_LINE = 110
#: Rooms of which a plugin may import what is public, beside ``porocore`` itself and the modules of the root.
FOR_PLUGINS = ("core", "interfaces", "plugins", "cell", "surrogates", "macro", "testing")
#: Third-party packages that belong to plugins.
OF_PLUGINS = {"skfem", "pyamg", "mkl", "dolfinx", "basix", "ufl", "torch", "jax", "flax"}


def module_name(path, root):
    parts = list(path.relative_to(root).with_suffix("").parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


CORE_MODULES = {module_name(path, ROOT): path for path in sorted(CORE.rglob("*.py"))}
SOURCES = [*CORE_MODULES.values(), *(path for plugin in PLUGINS for path in sorted(plugin.rglob("*.py")))]


@cache
def tree_of(path):
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def imports(path):
    """(module, name or None, line) of every import, wherever it stands, and for type checkers only."""
    found = []

    def visit(node):
        if isinstance(node, ast.Import):
            found.extend((alias.name, None, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: a relative import"
            found.extend((node.module, alias.name, node.lineno) for alias in node.names)
        for child in ast.iter_child_nodes(node):
            visit(child)

    visit(tree_of(path))
    return found


#: Configurations that signatures below them mention, by imports for type checkers only; no further ones.
MENTIONED = {
    ("interfaces.cell", "cell.cell"),
    ("interfaces.cell", "cell.materials.prony"),
    ("plugins.border", "cell.materials.prony"),
    ("interfaces.macro", "macro.problem"),
    ("plugins.border", "macro.problem"),
    ("cell.family.mesh", "cell.cell"),
    ("cell.family.wall", "cell.cell"),
    ("cell.family.wall", "cell.conductivity.pore"),
}


def core_imports(path):
    """Modules of the core that a file imports, with lines; without those that its signatures may only mention."""
    own = module_name(path, ROOT).removeprefix("porocore.")
    for module, name, line in imports(path):
        if module.split(".")[0] == "porocore" and (own, module.removeprefix("porocore.")) not in MENTIONED:
            whole = f"{module}.{name}"
            yield (whole if whole in CORE_MODULES else module), name, line


def test_only_signatures_mention_what_is_above_them():
    for own, mentioned in MENTIONED:
        tree = tree_of(CORE_MODULES[f"porocore.{own}"])
        checked = [
            node
            for node in tree.body
            if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        ]
        modules = {
            child.module for block in checked for child in block.body if isinstance(child, ast.ImportFrom)
        }
        assert f"porocore.{mentioned}" in modules, (own, mentioned)


def room(module):
    """The room of a module, or the module of the root itself."""
    return module.split(".")[1] if "." in module else ""


def entries(folder):
    """Files and sub-rooms of a room."""
    found = {path.name for path in folder.glob("*.py")} | {
        f"{path.parent.name}/" for path in folder.glob("*/__init__.py")
    }
    return found - {"__init__.py"}


def test_the_root_holds_rooms_and_three_modules():
    modules = (*ROOT_MODULES, "__main__")
    assert entries(CORE) == {f"{name}/" for name in ROOMS} | {f"{name}.py" for name in modules}


def test_rooms_are_packages_two_deep_at_most():
    faults = []
    for folder in sorted({path.parent for path in CORE_MODULES.values()} - {CORE}):
        where = folder.relative_to(ROOT)
        if not (folder / "__init__.py").is_file():
            faults.append(f"{where} has no __init__.py")
        if len(folder.relative_to(CORE).parts) > 2:
            faults.append(f"{where} is a room in a room in a room")
    assert faults == []


def test_no_two_public_classes_have_one_name():
    files = {}
    for path in SOURCES:
        for node in tree_of(path).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                files.setdefault(node.name, []).append(str(path.relative_to(ROOT)))
    assert {name: paths for name, paths in files.items() if len(paths) > 1} == {}


def test_the_core_imports_no_plugin_nor_their_packages():
    faults = [
        f"{module}:{line} imports {imported}"
        for module, path in CORE_MODULES.items()
        for imported, _, line in imports(path)
        if imported.startswith("porocore_") or imported.split(".")[0] in OF_PLUGINS
    ]
    assert faults == []


def may_import(own, imported):
    """Return whether a room, or a module of the root, may import a module of the core."""
    # The package itself reaches everywhere, lazily; only the command line asks it, for its version.
    if imported == "porocore":
        return own == "cli"
    if own in ROOT_MODULES:
        return imported.startswith("porocore.core.fields")
    return room(imported) in {own, *ROOT_MODULES, *ROOMS[own]}


def test_a_room_imports_only_the_rooms_that_it_may():
    faults = [
        f"{module}:{line} imports {name} from {imported}"
        for module, path in CORE_MODULES.items()
        if module not in ("porocore", "porocore.__main__")
        for imported, name, line in core_imports(path)
        if not may_import(room(module), imported)
    ]
    assert faults == []


def test_rooms_are_listed_from_the_ground_up_and_with_what_they_import():
    known: list[str] = []
    for name, allowed in ROOMS.items():
        assert set(allowed) <= set(known), f"{name} may import a room above it"
        used = {
            room(imported)
            for module, path in CORE_MODULES.items()
            if room(module) == name
            for imported, _, _ in core_imports(path)
        }
        assert set(allowed) <= used, f"{name} imports none of {sorted(set(allowed) - used)}"
        known.append(name)


def test_no_module_of_the_core_imports_itself_in_a_circle():
    graph = {
        module: {imported for imported, _, _ in core_imports(path) if imported not in ("porocore", module)}
        for module, path in CORE_MODULES.items()
        if module not in ("porocore", "porocore.__main__")
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
    "plugins.border",
    "testing",
    "commands.verify",
    "commands.reproduce.study",
    "study.tuning",
    "surrogates",
    "interfaces",
)


def test_what_comes_out_of_a_plugin_passes_the_border():
    faults = []
    for module, path in CORE_MODULES.items():
        if module[9:].startswith(BEFORE_THE_BORDER):
            continue
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                called, of = node.func.attr, ast.unparse(node.func.value)
                crosses = {
                    "predict": True,
                    "solve_one": True,
                    "ask": of.endswith("sampler") and module != "porocore.sampling.campaign",
                    "solve": of.endswith("solver"),
                    "relax": of.endswith("solver"),
                    "conductivity": of.endswith("solver"),
                }
                if crosses.get(called, False):
                    faults.append(f"{module}:{node.lineno} calls {of}.{called}; see porocore.plugins.border")
    assert faults == []


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
                assert room(imported) in (*ROOT_MODULES, *FOR_PLUGINS), f"{where}:{line} imports {imported}"


@pytest.mark.parametrize("plugin", PLUGINS, ids=lambda path: path.name)
def test_the_hooks_of_a_plugin_are_light(plugin):
    code = f"""
        import sys
        import {plugin.name}.hooks
        print([name for name in ("torch", "skfem", "gmsh", "matplotlib", "scipy") if name in sys.modules])
    """
    assert run_python(code) == "[]"


def test_the_page_of_the_architecture_is_the_tree():
    page = (ROOT / "docs/architecture.md").read_text(encoding="utf-8")
    for name, allowed in ROOMS.items():
        row = re.search(rf"^\| `{name}` \| (.*) \|$", page, re.MULTILINE)
        assert row, f"docs/architecture.md has no row of the room {name}"
        assert tuple(re.findall(r"[a-z]+", row[1])) == allowed, f"docs/architecture.md, room {name}"
    tree = re.search(r"^```\nporocore/\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    assert tree, "docs/architecture.md has no tree that begins with porocore/"
    told, above = set(), ""
    for line in tree[1].splitlines():
        indent, name = re.match(r"( *)(\S+)", line).groups()
        if len(indent) == 2:
            above = name
            told.add(name)
        elif len(indent) == 4:
            told.add(above + name)
    there = {f"{name}/" for name in ROOMS} | {
        f"{name}.py" for name in ("__init__", "__main__", *ROOT_MODULES)
    }
    there |= {f"{name}/{entry}" for name in ROOMS for entry in entries(CORE / name)}
    assert told == there


def test_the_page_has_the_first_line_of_every_file():
    command = [sys.executable, str(ROOT / "docs" / "make_architecture.py"), "--check"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    page = (ROOT / "docs/architecture.md").read_text(encoding="utf-8")
    missing = [str(path) for path in SOURCES if f"  {path.name} " not in page and path.name != "__init__.py"]
    assert missing == []


def test_the_first_line_of_a_module_is_short_and_whole():
    faults = []
    for path in SOURCES:
        first, _, rest = (ast.get_docstring(tree_of(path)) or "").partition("\n")
        if (
            len(first) > MOST_OF_A_FIRST_LINE
            or not first.endswith(".")
            or (rest and not rest.startswith("\n"))
        ):
            faults.append(f"{path.relative_to(ROOT)}: {first}")
    assert faults == []


def test_there_are_plugins_and_modules_to_look_at():
    assert {path.name for path in PLUGINS} >= {"porocore_fem_skfem", "porocore_surrogate_torch"}
    assert {
        "porocore.states",
        "porocore.interfaces.cell",
        "porocore.plugins.registry",
        "porocore.cli.entry",
    } <= set(CORE_MODULES)


def run_python(code):
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


@pytest.mark.parametrize("package", [porocore, porocore.interfaces, porocore.testing])
def test_what_is_typed_as_public_is_what_is_public(package):
    """The stub is read by type checkers and by the package itself."""
    stub = tree_of(Path(f"{package.__file__}i"))
    typed = {
        alias.asname: (node.module, alias.name)
        for node in stub.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert sorted(typed) == package.__all__
    for name, (module, original) in typed.items():
        assert getattr(package, name) is getattr(importlib.import_module(module), original), name


def test_what_is_not_public_is_no_attribute():
    with pytest.raises(AttributeError, match="no attribute 'frobnicate'"):
        _ = porocore.frobnicate


def test_only_the_command_line_prints_or_exits_and_nothing_is_unpickled():
    faults = []
    for module, path in CORE_MODULES.items():
        speaks = module.startswith("porocore.cli") or module == "porocore.core.console"
        # A worker process that has lost its parent may end itself, and the copy of a process that tries a file.
        ends = module in ("porocore.core.parallel.children", "porocore.core.hdf5_trial")
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.Call) and not speaks:
                called = ast.unparse(node.func)
                if called in ("print", "exit", "quit", "sys.exit") or (called == "os._exit" and not ends):
                    faults.append(f"{module}:{node.lineno} calls {called}")
            pickles = isinstance(node, ast.keyword) and node.arg == "allow_pickle"
            if pickles and ast.unparse(node.value) != "False":
                faults.append(f"{module}:{node.value.lineno} allows pickles")
        used = {imported for imported, _, _ in imports(path)} & {"pickle", "shelve", "marshal"}
        faults += [f"{module} imports {name}" for name in sorted(used)]
    assert faults == []
