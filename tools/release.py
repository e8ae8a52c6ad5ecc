"""What belongs to a release beside its distributions: one version in all files, the notes, the recipe for conda.

.venv/bin/python tools/release.py check [v0.1.0] [--notes FILE]
.venv/bin/python tools/release.py recipe --dist dist --out build/recipe [--sdists URL]
"""

from __future__ import annotations

import argparse
import hashlib
import re
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
#: Characters of the text of a release that GitHub takes.
LONGEST = 125_000
#: What stands in the recipe until an sdist is there to be hashed.
NO_HASH = "0" * 64


def versions(root: Path = ROOT) -> dict[str, str]:
    """Version by the file that states it: each project, the citation, the top section of the changelog."""
    found = {}
    for path in [root / "pyproject.toml", *sorted((root / "plugins").glob("*/pyproject.toml"))]:
        project = tomllib.loads(path.read_text(encoding="utf-8"))["project"]
        found[path.relative_to(root).as_posix()] = str(project["version"])
    citation = (root / "CITATION.cff").read_text(encoding="utf-8")
    found["CITATION.cff"] = "".join(re.findall(r"^version: *(\S+)", citation, re.MULTILINE)) or "none"
    found["CHANGELOG.md"] = top_section(root)[0].partition(" ")[0]
    recipe = (root / "packaging/conda/recipe.yaml").read_text(encoding="utf-8")
    found["packaging/conda/recipe.yaml"] = (
        "".join(re.findall(r'^  version: "(.*)"', recipe, re.MULTILINE)) or "none"
    )
    return found


def top_section(root: Path = ROOT) -> tuple[str, str]:
    """Heading and text of the first section of the changelog, the text without surrounding blank lines."""
    text = (root / "CHANGELOG.md").read_text(encoding="utf-8")
    heading, _, rest = text.partition("\n## ")[2].partition("\n")
    return heading, rest.partition("\n## ")[0].strip() + "\n"


def faults(tag: str | None, root: Path = ROOT) -> list[str]:
    """Reasons why this checkout is no release; none: it is one.

    Parameters
    ----------
    tag
        The release's tag, such as ``v0.1.0``. Without one nothing is released yet, and the changelog needs no date.
    """
    found = versions(root)
    version = tag.removeprefix("v") if tag else found["pyproject.toml"]
    wrong = [
        f"{file}: version {other}, expected {version}" for file, other in found.items() if other != version
    ]
    if tag and not tag.startswith("v"):
        wrong.insert(0, f"tag {tag}: expected v{tag}")
    heading, notes = top_section(root)
    if tag and not re.fullmatch(r"\S+ \(\d{4}-\d\d-\d\d\)", heading):
        wrong.append(
            f"CHANGELOG.md: section '{heading}', expected '{version} (YYYY-MM-DD)', the day of the release"
        )
    if len(notes) > LONGEST:
        wrong.append(f"CHANGELOG.md: section '{heading}' has {len(notes)} characters, GitHub takes {LONGEST}")
    return wrong


def recipe(dist: Path, sdists: str | None = None, root: Path = ROOT) -> str:
    """The recipe for conda with the places and hashes of the sdists in a folder.

    Parameters
    ----------
    dist
        Folder of the distributions.
    sdists
        Address below which a release has them; None: the folder.

    Raises
    ------
    FileNotFoundError
        The folder lacks an sdist of this version.
    """
    text = (root / "packaging/conda/recipe.yaml").read_text(encoding="utf-8")
    version = versions(root)["pyproject.toml"]

    def filled(match: re.Match[str]) -> str:
        path = dist / match["file"].replace("${{ version }}", version)
        url = f"{sdists or dist.resolve().as_uri()}/{match['file']}"
        return f"{match['before']}{url}{match['between']}{hashlib.sha256(path.read_bytes()).hexdigest()}"

    pattern = rf"(?P<before>url: )sdists/(?P<file>[^/]+\.tar\.gz)(?P<between>\n +sha256: ){NO_HASH}"
    return re.sub(pattern, filled, text)


def main() -> int:
    """Check, or write the recipe."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    commands = parser.add_subparsers(dest="command", required=True)
    check = commands.add_parser("check", help="that all files state one version")
    check.add_argument("tag", nargs="?", help="such as v0.1.0; without: before the release")
    check.add_argument("--notes", type=Path, help="write the section of the changelog into this file")
    write = commands.add_parser("recipe", help="write the recipe for conda with the hashes of the sdists")
    write.add_argument("--dist", type=Path, default=ROOT / "dist", help="default: dist")
    write.add_argument(
        "--out", type=Path, default=ROOT / "build/recipe", help="folder; default: build/recipe"
    )
    write.add_argument("--sdists", help="address below which the release has them; default: --dist")
    options = parser.parse_args()
    if options.command == "recipe":
        try:
            text = recipe(options.dist, options.sdists)
        except FileNotFoundError as error:
            print(f"{error.filename} is missing; run: make dist", file=sys.stderr)
            return 2
        options.out.mkdir(parents=True, exist_ok=True)
        (options.out / "recipe.yaml").write_text(text, encoding="utf-8")
        return 0
    wrong = faults(options.tag)
    print(*wrong, sep="\n", end="\n" if wrong else "", file=sys.stderr)
    if options.notes and not wrong:
        options.notes.write_text(top_section()[1], encoding="utf-8")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
