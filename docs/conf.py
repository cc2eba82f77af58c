"""How the pages are made: Markdown, no network, and every warning is an error (`make docs`)."""

import sys
import tomllib
from pathlib import Path

DOCS = Path(__file__).resolve().parent
sys.path.insert(0, str(DOCS / "_ext"))

project = "Palpate"
author = "The Palpate authors"
project_copyright = "The Palpate authors, Apache-2.0"
release = tomllib.loads((DOCS.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]

extensions = ["myst_parser", "mathml"]
myst_enable_extensions = ["dollarmath", "deflist", "colon_fence"]
myst_heading_anchors = 3
exclude_patterns = ["_build"]
nitpicky = True

html_theme = "furo"
html_title = f"Palpate {release}"
html_math_renderer = "mathml"
html_copy_source = False
html_show_sphinx = False
