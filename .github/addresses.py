"""The project's addresses in its metadata: those of the public repository that builds it.

No address is written in the sources, so that forks and mirrors name themselves. GitHub's runners
say in their environment where they are; an sdist keeps what was said when it was made.
"""

from __future__ import annotations

import os
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

PAGES = {
    "Repository": "",
    "Documentation": "/blob/HEAD/docs/index.md",
    "Changelog": "/blob/HEAD/CHANGELOG.md",
    "Issues": "/issues",
}


class Addresses(MetadataHookInterface):
    """Fills the table `urls` of the project."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Add the addresses, if a repository builds this."""
        repository = os.environ.get("GITHUB_REPOSITORY")
        if repository and "urls" not in metadata:  # those of an sdist stay
            server = os.environ.get("GITHUB_SERVER_URL", "https://github.com")
            home = f"{server}/{repository}"
            metadata["urls"] = {name: home + page for name, page in PAGES.items()}
