"""Build all distributions: an sdist of each, and each wheel from its sdist.

    .venv/bin/python tools/distributions.py [--out dist] [--no-isolation]

The folder holds the new files alone afterwards, or what it held before where one of them could not be built.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).resolve().parents[1]


def projects() -> list[Path]:
    """Folders of the core and of its plugins."""
    return [ROOT, *sorted(path.parent for path in (ROOT / "plugins").glob("*/pyproject.toml"))]


def build(out: Path, isolated: bool = True) -> list[Path]:
    """The sdists and wheels of all projects.

    Parameters
    ----------
    out
        Where they go; sdists and wheels that are there are removed.
    isolated
        Whether each is built in an environment of its own with what its ``build-system`` names, or with what is
        installed here.

    Raises
    ------
    subprocess.CalledProcessError
        One cannot be built; its output says why.
    """
    out.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=out, prefix=".new-") as folder:
        for project in projects():
            command = [sys.executable, "-m", "build", "--outdir", folder, str(project)]
            # Without a choice between the two 'build' makes the wheel from the sdist.
            subprocess.run([*command, *([] if isolated else ["--no-isolation"])], check=True)
        for old in [*out.glob("*.whl"), *out.glob("*.tar.gz")]:
            old.unlink()
        return [Path(shutil.move(path, out / path.name)) for path in sorted(Path(folder).iterdir())]


def main() -> int:
    """Build, and name the files."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="default: dist")
    parser.add_argument(
        "--no-isolation", action="store_true", help="with the build tools that are installed here"
    )
    options = parser.parse_args()
    try:
        files = build(options.out, not options.no_isolation)
    except subprocess.CalledProcessError as error:
        print(f"{' '.join(error.cmd)}: exit status {error.returncode}, see above", file=sys.stderr)
        return 2
    print(*files, sep="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
