"""What a wheel holds beside the sources: the description for an index page, and the kernels compiled ahead of time.

The README's own links are relative, as a checkout wants them. `PALPATE_URL` at build time is where the project's files
can be seen: links then lead there. Without it what they name stays as plain text: an index page has no files beside it.
"""

from __future__ import annotations

import os
import platform
import re
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from hatchling.metadata.plugin.interface import MetadataHookInterface

RELATIVE = re.compile(r"(?P<picture>!?)\[(?P<text>[^\]]*)\]\((?![a-z]+:|#)(?P<target>[^)]+)\)")


class CustomMetadataHook(MetadataHookInterface):
    """The two fields of pyproject.toml that depend on where the project is at home."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Write `readme`, and `urls` where they are known."""
        home = os.environ.get("PALPATE_URL", "").rstrip("/")
        text = Path(self.root, "README.md").read_text(encoding="utf-8")
        metadata["readme"] = {"content-type": "text/markdown", "text": for_an_index(text, home)}
        if home:
            files = f"{home}/blob/main"
            metadata["urls"] = {
                "Source": home,
                "Documentation": f"{files}/docs/index.md",
                "Changelog": f"{files}/CHANGELOG.md",
            }


class CustomBuildHook(BuildHookInterface[Any]):
    """The extension module: for both levels of x86-64 processors in a wheel, for this one in a checkout."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build it, and name the platform; where it cannot be built the wheel is one of Python alone.

        `PALPATE_NATIVE=0` skips it: `make setup` builds it after the environment.
        """
        if os.environ.get("PALPATE_NATIVE") == "0":
            return
        sys.path.insert(0, self.root)
        native = import_module("native_build")
        editable = version == "editable"
        built = native.main(() if editable or platform.machine() != "x86_64" else native.LEVELS)
        if built and not editable:
            build_data["artifacts"] += [str(file.relative_to(self.root)) for file in built]
            build_data.update(pure_python=False, infer_tag=True)


def for_an_index(readme: str, home: str) -> str:
    """A README whose relative links lead to the files at `home`; "": they become their text, and pictures nothing."""

    def link(found: re.Match[str]) -> str:
        picture, text, target = found["picture"], found["text"], found["target"]
        if not home:
            return "" if picture else text
        return f"{picture}[{text}]({home}/{'raw' if picture else 'blob'}/main/{target})"

    return RELATIVE.sub(link, readme)
