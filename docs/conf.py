"""Settings of the documentation site; ``make docs`` builds it.

The pages are where GitHub shows them, in docs/ and at the root, so the source directory is the repository itself and
a link that works on GitHub works on the site.
"""

import sys
from importlib.metadata import version as version_of
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "extensions"))

project = "porocore"
author = "The porocore developers"
copyright = f"{author}, MIT licence"
version = release = version_of("porocore")
language = "en"
# "--resume" stays what is typed.
smartquotes = False

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "signatures",
    "commands",
    "equations",
    "front_page",
    "laws",
    "notebooks",
]

root_doc = "docs/index"
include_patterns = [
    "docs/*.md",
    "docs/*/*.md",
    "docs/*.ipynb",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "README.md",
    "benchmarks/README.md",
    "examples/calibrations/README.md",
    "examples/plugins/*/README.md",
    "plugins/*/README.md",
]
# Folders that need not be walked through.
exclude_patterns = [".*", "build", "dist", "runs", "porocore", "**/.*", "**/node_modules"]

# ---- Markdown -----------------------------------------------------------------------------------

myst_enable_extensions = ["amsmath", "dollarmath"]
# As on GitHub: a heading can be linked to by its words.
myst_heading_anchors = 4

# ---- Equations ----------------------------------------------------------------------------------

html_math_renderer = "mathml"

# ---- API ----------------------------------------------------------------------------------------

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
# The names are documented once, where the reference pages put them.
autosummary_generate = False
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_param = False
napoleon_use_rtype = False
python_maximum_signature_line_length = 90
add_module_names = False

nitpicky = True
nitpick_ignore_regex = [
    # Other packages: their pages are not at hand where the site is built without a network.
    (
        "py:.*",
        r"(annotated_types|collections|concurrent|numpy|pathlib|pluggy|pydantic|pyvista|typing|xarray)\..*",
    ),
    # The inside of porocore, which the pages of the reference leave out.
    (
        "py:class",
        r"(porocore\.interfaces\.(cell|macro)\.)?Prepared|porocore\.(cell\.(contact|materials|meshing|stability\.map)|core|macro\.(analytic|problem\.TimePlan)|study\.(api\.solved\.T|config|run\.folder|tuning)"
        r"|plugins\.kinds\.Scaffold|testing\.sampler_checks|commands\.(calibration|fields\.points|sensitivity\.(plan|results)|representative))\b.*",
    ),
    # An alias of states.py and classes of the core where they are imported for type checkers only.
    ("py:class", "Array"),
    ("py:class", "Relaxation"),
    ("py:class", "YamlDocument"),
    # What stands where a type stands in a docstring, such as (n, 3, 3).
    ("py:class", r"(?!porocore\.)[^A-Z].*"),
]

# ---- HTML ---------------------------------------------------------------------------------------

html_theme = "furo"
html_title = f"porocore {release}"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_show_sphinx = False
html_copy_source = False
html_show_sourcelink = False
html_theme_options = {"navigation_with_keys": True}
