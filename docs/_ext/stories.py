"""Stories: pages whose commands run when the site is built, each answer below its command."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

BLOCK = re.compile(r"^```(sh|python)\n(.*?)^```\n", re.MULTILINE | re.DOTALL)
"""What is run of a page: commands of a shell, and whole Python scripts."""


def pages(docs: Path) -> list[Path]:
    """Return the pages that are run."""
    return [*sorted((docs / "stories").glob("*.md")), docs / "faq.md"]


def jobs(docs: Path) -> list[Callable[[], None]]:
    """Return what runs each page; answers and pictures go to generated/stories."""
    return [partial(_keep, docs, page) for page in pages(docs)]


def _keep(docs: Path, page: Path) -> None:
    """Write what the blocks of a page print, unless that is newer than page and files.

    Raises:
        RuntimeError: A command of the page fails.
    """
    folder = docs / "generated" / "stories" / page.stem
    said, files = folder / "answers.json", sorted((docs / "stories").glob("[!.]*.*"))
    newest = max(path.stat().st_mtime for path in (page, *files))
    if not said.exists() or said.stat().st_mtime < newest:
        folder.mkdir(parents=True, exist_ok=True)
        for path in files:
            if path.suffix != ".md":
                shutil.copy(path, folder)
        said.write_text(json.dumps(run(page, folder)), encoding="utf-8")


def run(page: Path, folder: Path) -> list[str]:
    """Return what each block of a page prints, run one after the other in a folder.

    Raises:
        RuntimeError: A block fails.
    """
    found = os.pathsep.join((str(Path(sys.executable).parent), os.environ["PATH"]))
    env, answers = os.environ | {"MPLBACKEND": "Agg", "PATH": found}, []
    for language, code in BLOCK.findall(page.read_text(encoding="utf-8")):
        words = ("sh", "-ec") if language == "sh" else (sys.executable, "-W", "ignore", "-c")
        done = subprocess.run(
            [*words, code], cwd=folder, env=env, capture_output=True, text=True, check=False
        )
        if done.returncode:
            raise RuntimeError(f"{page}: {code}fails: {done.stdout}{done.stderr}")
        answers.append("\n".join(line.rstrip() for line in done.stdout.splitlines()))
    return answers


def answered(app: object, name: str, source: list[str]) -> None:
    """Put below each block of a page what it printed."""
    docs = Path(app.srcdir)  # type: ignore[attr-defined]
    if docs / f"{name}.md" in pages(docs):
        kept = docs / "generated" / "stories" / Path(name).name / "answers.json"
        answers = iter(json.loads(kept.read_text(encoding="utf-8")))

        def told(block: re.Match[str]) -> str:
            text = next(answers)
            return f"{block.group(0)}\n```text\n{text}\n```\n" if text else block.group(0)

        source[0] = BLOCK.sub(told, source[0])
