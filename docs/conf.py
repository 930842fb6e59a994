"""Settings of the site: `python -m sphinx -W docs docs/_build/html` builds it."""

import os
import shutil
import sys
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import version as installed
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_ext"))

import generated  # noqa: E402
import links  # noqa: E402
import parameters  # noqa: E402
import recorded  # noqa: E402
import stories  # noqa: E402

import examples  # noqa: E402

project = "spacearm"
author = "The spacearm developers"
copyright = f"2026, {author}"  # noqa: A001
release = installed("spacearm")
version = release.split("+")[0]

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.mathjax",
    "sphinx-mathjax-offline",
    "sphinx.ext.viewcode",
]
exclude_patterns = ["_build", "_ext", "generated", "jupyter_execute", "**.ipynb_checkpoints"]
html_theme = "furo"
html_title = f"spacearm {version}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_extra_path = ["generated/site"]  # recorded pages
html_theme_options = {"navigation_with_keys": True}
html_show_sphinx = False

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3

nb_execution_mode = "cache"  # once for each change of a notebook; CI starts without a cache
nb_execution_raise_on_error = True
nb_execution_show_tb = True
nb_execution_timeout = 600
nb_render_markdown_format = "myst"
nb_merge_streams = True

default_role = "py:obj"  # names in docstrings lead to where they are described
autodoc_typehints = "none"
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True}
napoleon_attr_annotations = False
napoleon_use_rtype = False
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
viewcode_line_numbers = True
suppress_warnings = ["ref.python"]  # fields of several classes have one name


def setup(app):
    """Write what is generated, copy the lessons; check all links of the pages at the end."""
    generated.write(HERE)
    run([*stories.jobs(HERE), *recorded.jobs(HERE), *examples.jobs(HERE)])
    app.extensions["sphinx-mathjax-offline"].parallel_read_safe = True  # it adds files alone
    copy_lessons()
    app.connect("source-read", stories.answered)
    app.connect("autodoc-process-docstring", escape_bars)
    app.connect("autodoc-skip-member", skip_fields)
    app.connect("doctree-read", parameters.tabulate)
    app.connect("build-finished", links.check)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def run(jobs) -> None:
    """Do what starts processes of its own, as many at a time as there are processors."""
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(lambda job: job(), jobs))


def copy_lessons() -> None:
    """Copy the notebooks beside the pages, where they are executed."""
    notebooks, lessons = HERE.parent / "notebooks", HERE / "lessons"
    lessons.mkdir(exist_ok=True)
    for source in (*sorted(notebooks.glob("*.ipynb")), *sorted(notebooks.glob("*.py"))):
        copy = lessons / source.name
        if not copy.exists() or copy.read_bytes() != source.read_bytes():
            shutil.copy(source, copy)


def escape_bars(_app, _what, _name, _thing, _options, lines):
    """Take bars in docstrings, as in |S|, for what they are."""
    lines[:] = [line.replace("|", "\\|") for line in lines]


def skip_fields(_app, _what, _name, thing, skip, _options):
    """Leave out the fields of named tuples, which the attributes of the class describe."""
    return skip or "Alias for field number" in (getattr(thing, "__doc__", None) or "")
