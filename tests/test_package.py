"""The package from outside: the wheel elsewhere, import cost, README."""

import os
import re
import subprocess
import sys
import tarfile
import venv
import zipfile
from pathlib import Path

import pytest
from helpers.commands import spacearm
from packaging.metadata import Metadata
from packaging.version import Version

ROOT = Path(__file__).resolve().parent.parent


def python(executable, *words, **options):
    env = options.pop("env", {k: v for k, v in os.environ.items() if k != "PYTHONPATH"})
    command = [executable, *map(str, words)]
    run = subprocess.run(command, capture_output=True, text=True, check=False, env=env, **options)
    assert run.returncode == 0, run.stderr
    return run


@pytest.fixture(scope="module")
def wheel_python(tmp_path_factory):
    """A fresh environment with the wheel in it, and this one's packages but spacearm."""
    folder = tmp_path_factory.mktemp("elsewhere")
    python(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder, cwd=ROOT)
    (wheel,) = folder.glob("spacearm-*.whl")
    venv.create(folder / "env", with_pip=True, symlinks=True)
    executable = folder / "env" / "bin" / "python"
    (site,) = (folder / "env" / "lib").glob("python*/site-packages")
    ours = [path for path in sys.path if path.startswith(sys.prefix) and "site-packages" in path]
    (site / "dependencies.pth").write_text("\n".join(ours))
    install = ("-m", "pip", "install", "--quiet", "--no-index", "--no-deps", wheel)
    python(executable, *install, cwd=folder)
    return executable, folder


@pytest.mark.slow
def test_the_wheel_works_elsewhere(wheel_python):
    executable, folder = wheel_python
    code = "import spacearm as sa; print(sa.__file__); print(sa.load('planar2'), sa.load('mda6'))"
    run = python(executable, "-c", code, cwd=folder)
    assert run.stdout.startswith(str(folder))
    run = python(executable.parent / "spacearm", "info", "planar2", cwd=folder)
    assert "joint_2" in run.stdout


@pytest.mark.slow
def test_the_wheel_is_complete(wheel_python):
    _, folder = wheel_python
    (site,) = (folder / "env" / "lib").glob("python*/site-packages")
    data = {".json", ".h", ".c", ".js", ".css", ".html", ".mplstyle", ".typed"}
    own = [path for path in (ROOT / "spacearm").rglob("*") if path.suffix in data]
    assert len(own) > 30
    assert all((site / path.relative_to(ROOT)).is_file() for path in own)
    models = {path.name for path in (ROOT / "models").iterdir()}
    assert {path.name for path in (site / "spacearm" / "models").iterdir()} == models
    entry = next(site.glob("spacearm-*.dist-info")) / "entry_points.txt"
    assert "spacearm = spacearm.__main__:main" in entry.read_text()


def test_import_is_light():
    run = python(sys.executable, "-X", "importtime", "-c", "import spacearm; spacearm.load")
    imported = set(re.findall(r"\|\s+(\S+)$", run.stderr, re.MULTILINE))
    heavy = {"matplotlib", "meshcat", "typer", "rich", "trimesh", "xacro", "yourdfpy"}
    heavy |= {"xarray", "zarr", "dask", "distributed", "numba", "llvmlite", "contourpy"}
    heavy |= {"scipy.optimize", "scipy.integrate", "scipy.spatial", "scipy.sparse"}
    assert not heavy & imported


def test_every_public_name_is_there_and_documented():
    import spacearm as sa

    for name in sa.__all__:
        thing = getattr(sa, name)
        assert name == "__version__" or thing.__doc__, name


BUILT = [ROOT / "docs" / name for name in ("api", "generated", "generated/examples", "lessons")]
"""Folders that the build of the site fills; it checks the links to them."""
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))


def blocks(language, *pages):
    """The code blocks of some pages, of README and of all in docs/ if none is given."""
    texts = (page.read_text(encoding="utf-8") for page in pages or PAGES)
    found = (re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL) for text in texts)
    return [block for blocks in found for block in blocks]


WITH_PYTHON = [page for page in PAGES if blocks("python", page)]


@pytest.mark.slow
@pytest.mark.parametrize("page", WITH_PYTHON, ids=lambda page: page.stem)
def test_python_of_a_page_runs_from_top_to_bottom(page, tmp_path):
    text = "\n".join(blocks("python", page))
    if "sa.sweep(" in text:
        pytest.importorskip("zarr")  # which needs Python 3.11
    python(sys.executable, "-W", "error", "-c", text, cwd=tmp_path)


def test_commands_in_the_readme_exist():
    """Every spacearm command of README and docs/ is one, and its options are too."""
    lines = [line for block in blocks("sh") for line in block.splitlines()]
    commands = [line.split("#")[0].split() for line in lines if line.startswith("spacearm ")]
    assert len(commands) > 5
    for words in commands:
        usage = spacearm(words[1], "--help").stdout
        for word in words:
            assert not word.startswith("--") or word in usage, f"{words}: {word}"


ASKED = re.compile(
    r"spacearm ((?:simulate|plan) [^`\n]*--with (\w+\.toml)).*?```toml\n(.*?)```", re.DOTALL
)
"""A command that reads a file, the file's name, and the file, which stands below it."""


@pytest.mark.slow
@pytest.mark.parametrize("page", ["simulation", "planning"])
def test_questions_in_files_run(page, tmp_path):
    """Every TOML file that a page shows for --with, by the command above it."""
    pytest.importorskip("tomllib")
    asked = ASKED.findall((ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8"))
    assert asked
    for words, name, text in asked:
        (tmp_path / name).write_text(text, encoding="utf-8")
        run = spacearm(*words.split(), "--json", cwd=tmp_path)
        assert run.returncode == 0, run.stderr


def test_what_the_readme_shows_and_links_is_there():
    inside = set()
    for page in PAGES:
        links = re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8"))
        inside |= {(page.parent / link).resolve() for link in links if "://" not in link}
    missing = {path for path in inside if not path.is_file()}
    assert {path for path in missing if path.parent not in BUILT} == set()
    assert set((ROOT / "notebooks" / "pictures").iterdir()) <= inside


def test_what_the_readme_answers_is_what_the_command_says():
    words = ("-m", "spacearm", "query", "planar2", "--deg", "-65", "-11.41")
    said = [line.rstrip() for line in python(sys.executable, *words).stdout.splitlines()]
    shown = re.findall(r"```text\n(.*?)```", PAGES[0].read_text(encoding="utf-8"), re.DOTALL)
    assert shown[0].splitlines() == said


@pytest.mark.slow
def test_output_survives_a_plain_ascii_terminal():
    env = os.environ | {"PYTHONIOENCODING": "ascii:backslashreplace", "NO_COLOR": "1"}
    words = ("-m", "spacearm", "query", "planar2", "--deg", "-65", "-11.41")
    assert "dynamic" in python(sys.executable, *words, env=env).stdout


# --- what is released -----------------------------------------------------------------------


@pytest.fixture(scope="module")
def archives(tmp_path_factory):
    """Wheel and sdist, and both once more from what the sdist holds, built in another year."""
    first, again = tmp_path_factory.mktemp("first"), tmp_path_factory.mktemp("again")
    python(sys.executable, "-m", "hatchling", "build", "-d", first, cwd=ROOT)
    with tarfile.open(next(first.glob("*.tar.gz"))) as sdist:
        safely = {"filter": "data"} if hasattr(tarfile, "data_filter") else {}
        sdist.extractall(again, **safely)
    (tree,) = again.iterdir()
    for path in tree.rglob("*"):
        os.utime(path, (1e9, 1e9))
        path.chmod(0o700 if path.is_dir() else 0o600)
    python(sys.executable, "-m", "hatchling", "build", "-d", again, cwd=tree)
    return first, again


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["*.whl", "*.tar.gz"])
def test_archives_are_reproducible_byte_for_byte(archives, kind):
    (one,), (other,) = (folder.glob(kind) for folder in archives)
    assert one.name == other.name
    assert one.read_bytes() == other.read_bytes()


@pytest.mark.slow
def test_nothing_is_in_the_wheel_twice(archives):
    with zipfile.ZipFile(next(archives[0].glob("*.whl"))) as wheel:
        contents = {name: wheel.read(name) for name in wheel.namelist()}
    filled = [content for content in contents.values() if content.strip()]
    assert len(filled) == len(set(filled))
    assert any(name.endswith("licenses/spacearm/viewer/page/uplot/LICENSE") for name in contents)


@pytest.mark.slow
def test_the_sdist_is_complete(archives):
    with tarfile.open(next(archives[0].glob("*.tar.gz"))) as sdist:
        inside = {name.partition("/")[2] for name in sdist.getnames()}
    for name in ("LICENSE", "SECURITY.md", "CHANGELOG.md", "CITATION.cff", "pyproject.toml"):
        assert name in inside
    parts = (ROOT / "spacearm", ROOT / "models", ROOT / "tests")
    files = (path for part in parts for path in part.rglob("*") if path.is_file())
    kept = {path.relative_to(ROOT).as_posix() for path in files if "cache" not in str(path)}
    assert kept <= inside


@pytest.mark.slow
def test_metadata_is_complete(archives):
    now = python(sys.executable, "-m", "hatchling", "version", cwd=ROOT).stdout.strip()
    with zipfile.ZipFile(next(archives[0].glob("*.whl"))) as wheel:
        (name,) = (name for name in wheel.namelist() if name.endswith("METADATA"))
        found = Metadata.from_email(wheel.read(name))  # refuses what is not valid
    assert found.version == Version(now)
    assert found.license_expression == "BSD-3-Clause"
    assert found.license_files == ["LICENSE", "spacearm/viewer/page/uplot/LICENSE"]
    assert found.summary
    assert found.keywords
    assert found.author
    assert found.description_content_type == "text/markdown"
    assert found.description == (ROOT / "README.md").read_text(encoding="utf-8")
    for minor in (10, 11, 12, 13):
        assert f"Programming Language :: Python :: 3.{minor}" in found.classifiers
        assert found.requires_python.contains(f"3.{minor}.0")
    for requirement in found.requires_dist:
        assert requirement.specifier, f"{requirement} has no bound"


# --- public names ---------------------------------------------------------------------------


def test_dir_and_help_show_the_public_names_in_groups_and_nothing_else():
    import pydoc

    import spacearm as sa

    assert dir(sa) == sorted(sa.__all__)
    assert len(set(sa.__all__)) == len(sa.__all__)
    table = sa.__doc__.split("===\n")[1].split("\n===")[0]
    grouped = [word for line in table.splitlines() for word in line[13:].split()]
    assert sorted([*grouped, "__version__"]) == sorted(sa.__all__)
    page = pydoc.plain(pydoc.render_doc(sa))
    functions = page[page.index("\nFUNCTIONS") : page.index("\nVERSION")]
    listed = set(re.findall(r"^    (\w+)\(", functions, re.MULTILINE))
    assert listed == {name for name in sa.__all__ if name[0].islower()} - {"design"}


def test_names_are_imported_from_where_type_checkers_see_them():
    import ast
    from importlib import import_module

    import spacearm as sa

    stub = ast.parse(Path(sa.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    seen = {"__version__"}
    for node in stub.body:
        for name in node.names if isinstance(node, ast.ImportFrom) else ():
            assert name.name == name.asname
            assert getattr(sa, name.name) is getattr(import_module(node.module), name.name)
            seen.add(name.name)
    assert seen == set(sa.__all__)


def test_an_unknown_name_is_an_attribute_error():
    import spacearm as sa

    with pytest.raises(AttributeError, match="has no attribute 'singular'") as caught:
        _ = sa.singular
    assert caught.value.name == "singular"
    assert caught.value.obj is sa


def test_a_name_imports_no_more_than_it_needs():
    code = "import sys, spacearm as sa; sa.load('planar2'); print(*sys.modules)"
    loaded = set(python(sys.executable, "-c", code).stdout.split())
    assert "spacearm.model.arm" in loaded
    assert not {"spacearm.planning", "spacearm.motion", "spacearm.plots", "numba"} & loaded


@pytest.mark.parametrize(
    ("words", "idle"),
    [
        ("query planar2 --deg 60 70", ("interpolate", "optimize", "special", "stats")),
        ("simulate planar2 --deg 60 70 --target 1 0 --duration 1", ("stats",)),
    ],
)
def test_a_command_imports_of_scipy_what_it_uses(words, idle, tmp_path):
    code = (
        "import sys; from spacearm.cli.app import main; sys.exit = lambda _: print(*sys.modules); "
    )
    code += f"sys.argv[1:] = {words.split()}; main()"
    loaded = set(python(sys.executable, "-c", code, cwd=tmp_path, env=os.environ).stdout.split())
    assert "pinocchio" in loaded
    assert not {f"scipy.{part}" for part in idle} & loaded
