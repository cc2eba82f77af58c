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

extensions = ["myst_parser", "mathml", "docstrings", "rooms", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
extensions += ["sphinx_copybutton"]
myst_enable_extensions = ["dollarmath", "deflist", "colon_fence"]
myst_heading_anchors = 3
exclude_patterns = ["_build"]
nitpicky = True
FOREIGN = r"(np|pl|trimesh)\..*|Any|Callable|Hashable|Iterable|Iterator|Literal|Mapping|Path(Like)?|Self|Sequence"
nitpick_ignore_regex = [("py:class", FOREIGN)]  # of Python and of other libraries: their pages are on the network

autodoc_member_order = "bysource"
autodoc_typehints = "none"  # docs/_ext/docstrings.py shows them as they are written
maximum_signature_line_length = 90
napoleon_numpy_docstring = False
napoleon_attr_annotations = False
toc_object_entries = False  # each has a heading; the menu of all pages with every method takes a minute to draw
napoleon_use_ivar = True  # a dataclass's fields stand in its docstring, with units

html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["palpate.css"]
html_title = f"Palpate {release}"
html_math_renderer = "mathml"
html_copy_source = False
html_show_sphinx = False
