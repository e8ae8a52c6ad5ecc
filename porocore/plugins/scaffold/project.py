"""Files of a new plugin project, for ``porocore plugin new``."""

from __future__ import annotations

import datetime
import os
import re
import shutil
import subprocess
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from string import Template as Text

from porocore.core.echo import echo, reason
from porocore.core.files.reading import obstacle
from porocore.errors import ConfigurationError
from porocore.plugins.kinds import FIRST_PARTY, KINDS, Kind, kind_of
from porocore.plugins.registry import registry
from porocore.plugins.table import KIT_VERSION

NAME = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")
LONGEST = 40


def write_project(name: str, kind: str, to: Path | None = None) -> Path:
    """Write the project of a new plugin, whole or not at all.

    Parameters
    ----------
    name
        What users will write; small letters, digits and single hyphens.
    kind
        ``cell``, ``macro``, ``surrogate``, ``sampler`` or ``command``.
    to
        The new folder; by default ``porocore-KIND-NAME`` in the present one.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    ConfigurationError
        The kind or the name is of no use, the name is taken, the folder exists, or it cannot be written.
    """
    _check_name(name, kind_of(kind))
    distribution = f"porocore-{kind}-{name}"
    folder = Path(distribution) if to is None else to
    if found := obstacle(folder):
        raise ConfigurationError(f"--to {folder}: {found}; choose another --to")
    if folder.exists():
        raise ConfigurationError(
            f"{folder} is there already and is not overwritten; remove it, or choose another --to"
        )
    part = folder.with_name(f".{folder.name}.{os.getpid()}.part")
    try:
        for path, text in project_files(name, kind, distribution).items():
            target = part / path
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(text, encoding="utf-8", newline="\n")
        part.rename(folder)
    except OSError as error:
        raise ConfigurationError(f"cannot write {folder}: {reason(error)}; choose another --to") from None
    finally:
        shutil.rmtree(part, ignore_errors=True)
    return folder


def project_files(name: str, kind: str, distribution: str) -> dict[str, str]:
    """Return the texts of a project by their paths in it; ``kind`` as of :func:`write_project`."""
    name_of_kind = kind_of(kind)
    record, module = KINDS[name_of_kind], name_of_kind.replace(" ", "_")
    scaffold, title = record.scaffold, f"A {name_of_kind}"
    package, key = distribution.replace("-", "_"), name.replace("-", "_")
    words = {
        "name": name,
        "kind": kind,
        "words": name_of_kind,
        "distribution": distribution,
        "package": package,
        "module": module,
        "cls": _class_name(name, record.interface),
        "hook": record.hook,
        "entry_point": f"{kind}_{name.replace('-', '_')}",
        "title": title,
        "about": scaffold.about,
        "summary": scaffold.summary.format(about=scaffold.about),
        "chosen": scaffold.chosen,
        "usage": scaffold.usage.format(name=name, key=key),
        "key": key,
        "offer": record.offer,
        "more": scaffold.more.format(key=key),
        "requires": scaffold.requires,
        "dependencies": "".join(f', "{text}"' for text in scaffold.dependencies),
        "interface": str(record.versions.present),
        "kit": KIT_VERSION.partition(".")[0],
        "version": version("porocore"),
        "author": _author(distribution),
        "year": str(datetime.date.today().year),
    }
    sources = {
        "pyproject.toml": "common/pyproject.toml",
        "README.md": "common/README.md",
        "LICENSE": "common/LICENSE",
        ".gitignore": "common/gitignore",
        ".github/workflows/test.yml": "common/test.yml",
        f"{package}/hooks.py": "common/hooks.py",
        f"{package}/{module}.py": f"{kind}/{module}.py",
        f"{package}/conformance.py": f"{kind}/conformance.py",
        "tests/test_conformance.py": "common/test_conformance.py",
    }
    templates = files("porocore.plugins.scaffold") / "templates"
    texts = {
        path: Text((templates / f"{source}.txt").read_text(encoding="utf-8")).safe_substitute(words)
        for path, source in sources.items()
    }
    return texts | {f"{package}/__init__.py": f'"""{title} for porocore: {scaffold.about}."""\n'}


def _check_name(name: str, kind: Kind) -> None:
    if not NAME.fullmatch(name) or len(name) > LONGEST:
        raise ConfigurationError(
            f"NAME: expected small letters, digits and single hyphens, beginning with a letter, at most {LONGEST}, "
            f"such as my-{KINDS[kind].word}; got {echo(name)}"
        )
    owners = [
        str(offered.source)
        for offered in registry().offers
        if (offered.kind, offered.offer.name) == (kind, name)
    ]
    if name in FIRST_PARTY and kind in FIRST_PARTY[name][1]:
        owners.append(FIRST_PARTY[name][0])
    if owners:
        raise ConfigurationError(
            f"NAME: there is a {kind} '{name}' already, of {owners[0]}; choose another name"
        )


def _class_name(name: str, suffix: str) -> str:
    """Return ``MyGridSampler`` for ``my-grid``; an ending that the name has already is not repeated."""
    words = "".join(part.capitalize() for part in name.split("-"))
    return next(words + suffix[k:] for k in range(len(suffix), -1, -1) if words.endswith(suffix[:k]))


def _author(distribution: str) -> str:
    """Return the name of the user as git knows it."""
    try:
        found = subprocess.run(
            ["git", "config", "user.name"], capture_output=True, text=True, timeout=10, check=False
        )
        name = found.stdout.strip().replace('"', "'").replace("\\", "")
    except (OSError, subprocess.TimeoutExpired):
        name = ""
    return name or f"The authors of {distribution}"
