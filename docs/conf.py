"""How the documentation becomes a site: `make docs` writes it to ``docs/_build/html``.

Nothing comes from the network, neither now nor when a page is opened: equations are MathML with a
font of the site's own, the search runs in the page.
"""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path

from pygments.lexers.special import TextLexer
from sphinx.application import Sphinx

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE / "_site"), str(HERE.parent)]

project = "mavsentry"
copyright = "the mavsentry contributors, Apache-2.0"
with (HERE.parent / "pyproject.toml").open("rb") as _file:
    release = version = tomllib.load(_file)["project"]["version"]

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "mathml",
    "narrow",
]
exclude_patterns = ["_build", "_site"]
root_doc = "index"
# An option stays `--in` where it stands in a sentence.
smartquotes = False
nitpicky = False
# An owner's pages may come after the tree that lists them.

myst_enable_extensions = ["dollarmath", "amsmath", "deflist", "colon_fence"]
myst_heading_anchors = 4
myst_dmath_double_inline = True
myst_links_external_new_tab = False

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
napoleon_google_docstring = False
napoleon_use_rtype = False

copybutton_prompt_text = "$ "
copybutton_line_continuation_character = "\\"
# What is only shown has no button.
copybutton_selector = "div.highlight:not(.highlight-text *):not(.highlight-graph *) > pre"

math_numfig = False
html_math_renderer = "mathml"
html_theme = "furo"
html_title = f"mavsentry {version}"
html_short_title = "mavsentry"
html_static_path = ["_site/static"]
html_css_files = ["site.css"]
html_favicon = "_site/static/icon.svg"
html_logo = "_site/static/icon.svg"
# Excerpts are fetched, which browsers refuse to pages from the disk.
html_show_search_summary = False
html_show_sphinx = False
html_show_sourcelink = False
html_copy_source = False
html_use_index = False
html_theme_options = {
    "navigation_with_keys": True,
    "light_css_variables": {
        "color-brand-primary": "#1f5fa8",
        "color-brand-content": "#1f5fa8",
        "color-brand-visited": "#5b3f9e",
        "color-sidebar-link-text--top-level": "#33404d",
    },
    "dark_css_variables": {
        "color-brand-primary": "#8ab8f0",
        "color-brand-content": "#8ab8f0",
        "color-brand-visited": "#b9a3ee",
        "color-sidebar-link-text--top-level": "#c3cbd3",
    },
}
pygments_style = "github-light-high-contrast"
pygments_dark_style = "github-dark"


def setup(app: Sphinx) -> None:
    # MAVProxy's own, in docs/ground-stations.md.
    app.add_lexer("graph", TextLexer)
