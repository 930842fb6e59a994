"""What a release is made of says the same everywhere: versions, requirements, workflows."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement

try:
    import tomllib
except ModuleNotFoundError:  # Python 3.10
    import tomli as tomllib

ROOT = Path(__file__).resolve().parents[1]
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text())
PROJECT = SETTINGS["project"]
WRITTEN = SETTINGS["tool"]["hatch"]["version"]["raw-options"]["fallback_version"]
RECIPE = ROOT / "recipe" / "recipe.yaml"
WORKFLOWS = ROOT / ".github" / "workflows"
OF_CONDA = {"pin": "pinocchio", "matplotlib": "matplotlib-base", "meshcat": "meshcat-python"}
"""Names that packages have on conda-forge."""
KINDS = {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}
"""Of changes, as keepachangelog.com has them."""


def read(path):
    return yaml.safe_load(path.read_text(encoding="utf-8"))


def test_versions_are_one():
    citation = read(ROOT / "CITATION.cff")
    assert citation["version"] == WRITTEN == read(RECIPE)["context"]["version"]
    assert citation["license"] == PROJECT["license"] == read(RECIPE)["about"]["license"]


def clone(folder):
    """What the metadata is made of, without history."""
    for name in ("pyproject.toml", "README.md", ".github/addresses.py"):
        (folder / name).parent.mkdir(exist_ok=True)
        shutil.copy(ROOT / name, folder / name)


def call(folder, *arguments, **given):
    """What hatchling or git prints in a folder, without what the environment says of others."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("GIT_", "GITHUB_"))}
    me = ("-c", "user.name=a", "-c", "user.email=a@example.org")
    command = (sys.executable, "-m") if arguments[0] == "hatchling" else ("git", *me)
    return subprocess.run(
        (*command, *arguments), cwd=folder, env=environment | given, check=True,
        capture_output=True, text=True,
    ).stdout.strip()  # fmt: skip


def test_the_version_is_the_tag(tmp_path):
    clone(tmp_path)
    assert call(tmp_path, "hatchling", "version") == WRITTEN  # a copy without history
    call(tmp_path, "init", "-q")
    call(tmp_path, "add", ".")
    call(tmp_path, "commit", "-q", "-m", "a release")
    call(tmp_path, "tag", "v9.8.7")
    assert call(tmp_path, "hatchling", "version") == "9.8.7"
    call(tmp_path, "commit", "-q", "--allow-empty", "-m", "more")
    assert call(tmp_path, "hatchling", "version").startswith("9.8.7.post1.dev1+g")


def test_the_addresses_are_those_of_the_repository_that_builds(tmp_path):
    """And an sdist keeps them for whoever installs from it; elsewhere there are none."""
    clone(tmp_path)

    def urls(**given):
        found = json.loads(call(tmp_path, "hatchling", "metadata", **given))
        return found.get("urls", {})

    assert urls() == {}
    public = urls(GITHUB_SERVER_URL="https://git.example.org", GITHUB_REPOSITORY="arms/spacearm")
    assert public["Repository"] == "https://git.example.org/arms/spacearm"
    assert {"Documentation", "Changelog", "Issues"} < public.keys()
    about = ["Metadata-Version: 2.4", "Name: spacearm", f"Version: {WRITTEN}"]
    about += [f"Project-URL: {name}, {url}" for name, url in public.items()]
    (tmp_path / "PKG-INFO").write_text("\n".join(about))
    assert urls() == urls(GITHUB_REPOSITORY="other/fork") == public


def test_the_citation_has_what_the_format_asks_for():
    citation = read(ROOT / "CITATION.cff")
    assert citation["cff-version"] == "1.2.0"
    assert {"message", "title", "authors"} <= citation.keys()
    (paper,) = citation["references"]
    assert paper["doi"] == "10.1115/1.2897406"
    assert {"type", "title", "authors"} <= paper.keys()


def test_the_changelog_keeps_its_form():
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert text.startswith("# Changelog\n")
    versions = re.findall(r"^## (.*)$", text, re.MULTILINE)
    released = [v for v in versions if v != "Unreleased"]
    assert all(re.fullmatch(r"\d+\.\d+\.\d+ - \d{4}-\d\d-\d\d", version) for version in released)
    assert versions[0] == "Unreleased" or versions[0].startswith(WRITTEN)
    for part in re.split(r"^## .*$", text, flags=re.MULTILINE)[1:]:
        kinds = re.findall(r"^### (.*)$", part, re.MULTILINE)
        assert len(kinds) == len(set(kinds))
        assert set(kinds) <= KINDS


def test_the_recipe_asks_for_what_the_package_needs():
    needed = {r.name: r for r in map(Requirement, PROJECT["dependencies"])}
    bundled = {name for name in needed if name.startswith("cmeel-")}  # of Pinocchio's wheels only
    wanted = {
        OF_CONDA.get(name, name): r.specifier for name, r in needed.items() if name not in bundled
    }
    recipe = [r for r in read(RECIPE)["requirements"]["run"] if not r.startswith("python ")]
    assert {r.name: r.specifier for r in map(Requirement, recipe)} == wanted
    assert read(RECIPE)["context"]["python_min"] in PROJECT["requires-python"]


@pytest.mark.parametrize("path", [*WORKFLOWS.glob("*.yml")], ids=lambda path: path.name)
def test_a_workflow_has_jobs_of_steps_and_few_rights(path):
    workflow = read(path)
    assert workflow["permissions"] == {"contents": "read"}
    for job in workflow["jobs"].values():
        assert job["runs-on"]
        assert all(("uses" in step) != ("run" in step) for step in job["steps"])


def test_only_the_job_that_publishes_may_ask_for_a_token():
    jobs = read(WORKFLOWS / "publish.yml")["jobs"]
    rights = {name: job["permissions"] for name, job in jobs.items() if "permissions" in job}
    assert rights == {"publish": {"id-token": "write"}}
    assert jobs["publish"]["needs"] == "build"


def test_files_that_the_contributors_are_sent_to_exist():
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    for path in re.findall(r"`([\w./]+/[\w.-]+\.\w+)`", text):
        assert (ROOT / path).exists(), path
    for form in (ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml"):
        if form.stem != "config":
            assert {"name", "description", "body"} <= read(form).keys()


def test_what_the_paper_quotes_is_printed_elsewhere_by_the_same_command():
    paper = (ROOT / "paper" / "paper.md").read_text(encoding="utf-8")
    pages = [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]
    homes = [path.read_text(encoding="utf-8") for path in pages]
    asked = re.compile(r"(?:python (?:benchmarks|tests)/[\w/]+\.py|spacearm (?:query|plan) .*)")
    command, quoted = "", 0
    for part in re.split(r"^```text\n(.*?)^```$", paper, flags=re.MULTILINE | re.DOTALL):
        if quoted % 2:
            lines = part.splitlines()
            assert any(command in text and all(s in text for s in lines) for text in homes), part
        else:
            command = (asked.findall(part) or [command])[-1].strip()
        quoted += 1
    assert quoted > 10


def test_the_paper_cites_what_its_bibliography_has():
    paper = (ROOT / "paper" / "paper.md").read_text(encoding="utf-8")
    entries = re.findall(r"^@\w+\{(\w+),", (ROOT / "paper" / "paper.bib").read_text(), re.MULTILINE)
    assert set(re.findall(r"@(\w+\d{4})", paper)) == set(entries)
