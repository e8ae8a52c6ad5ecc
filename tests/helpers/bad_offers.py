"""Plugins with one fault each: name → (module's source, words that the line about it holds)."""

from textwrap import dedent

HEAD = "from porocore import Offer, hookimpl\n"


def _offer(**fields):
    """A module that offers a sampler with the given fields in place of good ones."""
    given = {"name": "'fine'", "load": "dict", "summary": "''"} | fields
    arguments = ", ".join(f"{field}={value}" for field, value in given.items())
    return f"{HEAD}@hookimpl\ndef porocore_samplers():\n    return [Offer({arguments})]\n"


def _hook(body, name="porocore_samplers", before=""):
    return f"{HEAD}{before}\n@hookimpl\ndef {name}():\n" + "".join(
        f"    {line}\n" for line in dedent(body).strip().splitlines()
    )


NAMED = "Offer.name: expected small letters and digits, parted by single hyphens or underscores"
SOURCES = {
    # An offer that is none.
    "name-number": (
        _offer(name="7"),
        f"{NAMED}, beginning with a letter, at most 40, such as 'my-grid', got 7",
    ),
    "name-empty": (_offer(name="''"), "got ''"),
    "name-spaces": (_offer(name="'my grid'"), "got 'my grid'"),
    "name-upper": (_offer(name="'MyGrid'"), "got 'MyGrid'"),
    "name-unicode": (_offer(name="'größe'"), "got 'größe'"),
    "name-newline": (_offer(name="'grid\\n'"), r"got 'grid\n'"),
    "name-option": (_offer(name="'--json'"), "got '--json'"),
    "name-long": (_offer(name="'x' * 4000"), "got 'xxxxx"),
    "name-none": (_offer(name="None"), "got None"),
    "load-class": (
        _offer(load="'acme.Grid'"),
        "Offer.load: expected a function that imports and returns the class, got 'acme.Grid'",
    ),
    "summary-none": (_offer(summary="None"), "Offer.summary: expected a text, got None"),
    "requires-text": (
        _offer(requires="'numpy'"),
        "Offer.requires: expected a list or tuple of modules, such as ('numpy',), got 'numpy'",
    ),
    "requires-number": (_offer(requires="('numpy', 3)"), "got ('numpy', 3)"),
    "requires-version": (_offer(requires="('numpy>=2',)"), "got ('numpy>=2',)"),
    "requires-empty": (_offer(requires="('',)"), "got ('',)"),
    "requires-none": (_offer(requires="None"), "Offer.requires: expected"),
    "install-list": (_offer(install="['pip']"), "Offer.install: expected a text, the command"),
    "suites-list": (_offer(suites="[]"), "Offer.suites: expected a function"),
    "two-faults": (_offer(name="7", requires="'numpy'"), "got 7; Offer.requires: expected"),
    "field-missing": (
        _hook("return [Offer(name='fine')]"),
        "missing 2 required positional arguments: 'load' and 'summary'",
    ),
    "field-unknown": (_offer(needs="()"), "unexpected keyword argument 'needs'"),
    "repr-fails": (
        _hook(
            "return [Offer(name=Odd(), load=dict, summary='')]",
            before="class Odd:\n    def __repr__(self): raise ValueError\n",
        ),
        "got an instance of Odd",
    ),
    # What a hook returns.
    "returns-none": (_hook("pass"), "porocore_samplers: expected a list of porocore.Offer, got None"),
    "returns-one": (
        _hook("return Offer('fine', dict, '')"),
        "expected a list of porocore.Offer, got Offer(name='fine'",
    ),
    "returns-text": (_hook("return ['grid']"), "got 'grid' in it"),
    "returns-class": (_hook("return [Offer]"), "got <class 'porocore.plugins.hookspecs.Offer'> in it"),
    "returns-generator": (_hook("yield Offer('fine', dict, '')"), "got <generator object"),
    "returns-foreign": (
        _hook(
            "return [Old()]",
            before="from types import SimpleNamespace\ndef Old(): return SimpleNamespace(name='fine', load=dict)\n",
        ),
        "got namespace(name='fine'",
    ),
    "changed-later": (
        _hook("offer = Offer('fine', dict, '')\nobject.__setattr__(offer, 'name', 7)\nreturn [offer]"),
        "got 7",
    ),
    "subclass": (
        _hook("return [Mine(7, dict, '')]", before="class Mine(Offer):\n    def __post_init__(self): pass\n"),
        "got 7",
    ),
    # What a hook raises.
    "raises": (_hook("raise ValueError('no licence')"), "porocore_samplers: ValueError: no licence"),
    "raises-exit": (_hook("import sys\nsys.exit(3)"), "porocore_samplers: SystemExit: 3"),
    "raises-base": (_hook("raise Halt('stop')", before="class Halt(BaseException): pass\n"), "Halt: stop"),
    "raises-silent": (
        _hook("raise Odd", before="class Odd(Exception):\n    def __str__(self): return 1 / 0\n"),
        "Odd: its message",
    ),
    "raises-long": (_hook("raise ValueError('x' * 10**6)"), "ValueError: xxx"),
    "raises-lines": (_hook("raise ValueError('one\\n\\x1b[31mtwo')"), "ValueError: one [31mtwo"),
    "recursion": (_hook("return porocore_samplers()"), "RecursionError"),
    # At import.
    "import-fails": (
        "import a_module_that_does_not_exist\n",
        "ModuleNotFoundError: No module named 'a_module_that_does_not_exist'",
    ),
    "import-exit": ("raise SystemExit('no licence')\n", "SystemExit: no licence"),
    "import-quits": ("quit()\n", "SystemExit"),
    "import-base": ("class Halt(BaseException): pass\nraise Halt('stop')\n", "Halt: stop"),
    "import-asserts": ("assert False, 'no'\n", "AssertionError: no"),
    "import-syntax": ("def porocore_samplers(:\n", "SyntaxError"),
    "import-cycle": ("from bad_import_cycle import hooks\n", "ImportError: cannot import name 'hooks'"),
    # Hooks and declarations.
    "no-hook": (HEAD, "no function of bad_no_hook is marked @hookimpl; the hooks are"),
    "unmarked": (
        HEAD + "def porocore_samplers(): return []\n",
        "no function of bad_unmarked is marked @hookimpl",
    ),
    "half-marked": (
        _offer() + "def porocore_surrogates(): return []\n",
        "the function porocore_surrogates is not marked @hookimpl",
    ),
    "hook-misspelt": (
        _hook("return []", "porocore_smaplers"),
        "no hook 'porocore_smaplers'; did you mean 'porocore_samplers'?",
    ),
    "hook-argument": (
        HEAD + "@hookimpl\ndef porocore_samplers(device): return []\n",
        "Argument(s) {'device'} are declared in the hookimpl but can not be found in the hookspec",
    ),
    "declared-misspelt": (
        "POROCORE_INTERFACE = {'sampler': 1}\n" + _offer(),
        "POROCORE_INTERFACE means nothing; did you mean POROCORE_INTERFACES?",
    ),
    "declared-lower": (
        "porocore_interfaces = {'sampler': 1}\n" + _offer(),
        "porocore_interfaces means nothing",
    ),
    "declared-number": (
        "POROCORE_INTERFACES = 1\n" + _offer(),
        "POROCORE_INTERFACES: expected a number for some of",
    ),
    "declared-text": ("POROCORE_INTERFACES = {'sampler': '1'}\n" + _offer(), "got {'sampler': '1'}"),
    "declared-true": ("POROCORE_INTERFACES = {'sampler': True}\n" + _offer(), "got {'sampler': True}"),
    "declared-kind": ("POROCORE_INTERFACES = {'smapler': 1}\n" + _offer(), "got {'smapler': 1}"),
    # Two of one name in one distribution.
    "twice": (
        _hook("return [Offer('twice', dict, ''), Offer('twice', dict, '')]"),
        "offers it 2 times; report this to its authors",
    ),
}
#: Those that are offered and break when the class is imported, name → words of the line under ``--load``.
LAZY = {
    "class-fails": (
        _offer(name="'class-fails'", load="lambda: 1 / 0"),
        "cannot be loaded: ZeroDivisionError: division by zero",
    ),
    "class-exits": (_offer(name="'class-exits'", load="quit"), "cannot be loaded: SystemExit"),
    "class-missing": (
        _offer(name="'class-missing'", load="lambda: __import__('acme_nothing')"),
        "cannot be loaded: ModuleNotFoundError: No module named 'acme_nothing'",
    ),
    "class-other": (
        _offer(name="'class-other'"),
        "is no subclass of porocore.Sampler: {}",
    ),
    "class-instance": (
        _offer(name="'class-instance'", load="lambda: 3"),
        "is no subclass of porocore.Sampler: 3",
    ),
    "class-wrong-kind": (
        _hook("from porocore import Surrogate\nreturn [Offer('class-wrong-kind', lambda: Surrogate, '')]"),
        "is no subclass of porocore.Sampler: <class 'porocore.interfaces.surrogate.Surrogate'>",
    ),
    "class-abstract": (
        _hook("from porocore import Sampler\nreturn [Offer('class-abstract', lambda: Sampler, '')]"),
        "does not implement __init__, ask, done, expected and tell",
    ),
    "load-argument": (
        _offer(name="'load-argument'", load="lambda kind: dict"),
        "missing 1 required positional argument: 'kind'",
    ),
}
#: A sampler that works; ``kit_version`` and ``suites`` are wrong.
GOOD = """
from porocore import Offer, Sampler, hookimpl
{before}
class Grid(Sampler):
    def __init__(self, inputs, **options): ...
    def ask(self): return []
    def tell(self, key, response): ...
    done = True
    expected = 0

def _suites():
    {suites}

@hookimpl
def porocore_samplers():
    return [Offer("{name}", lambda: Grid, "a\\n\\x1b[2Jgrid", suites={offered})]
"""


def good(name, before="", suites="", offered="None"):
    return GOOD.format(name=name, before=before, suites=suites or "return []", offered=offered)


def _pinned(version):
    return (
        "from porocore.testing import SamplerSuite\n"
        f"    return [type('TestGrid', (SamplerSuite,), {{'kit_version': {version}}})]"
    )


#: Those that work and are told what to mend, name → (source, words, only with ``--load``).
NOTED = {
    "prints": (
        good("prints", "print('hello from\\nacme')"),
        "prints when it is imported: 'hello from acme'",
        False,
    ),
    "prints-below": (
        good("prints-below", "import os; os.write(1, b'raw')"),
        "prints when it is imported: 'raw'",
        False,
    ),
    "replaces-stdout": (good("replaces-stdout", "import sys, io; sys.stdout = io.StringIO()"), "", False),
    "imports-long": (
        good("imports-long", "import time; time.sleep(0.3)"),
        "took 0.3 s, for which every command waits",
        False,
    ),
    "kit-number": (
        good("kit-number", suites=_pinned(2), offered="_suites"),
        "kit_version: expected a text such as",
        True,
    ),
    "kit-words": (good("kit-words", suites=_pinned("'two'"), offered="_suites"), "got 'two'", True),
    "kit-later": (
        good("kit-later", suites=_pinned("'99'"), offered="_suites"),
        "was made for version 99 of the kit",
        True,
    ),
    "suites-none": (
        good("suites-none", suites="return None", offered="_suites"),
        "cannot be loaded: TypeError",
        True,
    ),
    "suites-fail": (
        good("suites-fail", suites="import acme_laws", offered="_suites"),
        "No module named 'acme_laws'",
        True,
    ),
    "suites-other": (
        good("suites-other", suites="return [dict]", offered="_suites"),
        "expected suites of porocore.testing",
        True,
    ),
}
