"""Hooks of hatchling: no package without the page's JavaScript; an sdist keeps the tree's links.

And the package's own page, README.md, names nothing that an index does not have.
"""

import gzip
import io
import re
import sys
import tarfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from hatchling.metadata.plugin.interface import MetadataHookInterface

BESIDE = re.compile(r"(!?)\[([^][]*)\]\((?!https?:|#)([^)\s]*)\)")
"""A picture or a link of a page to a file beside it: its mark, its words and its path."""


def portable(page: str, address: str) -> str:
    """Return a page whose pictures and links lead to the tree at an address, from anywhere.

    Where none is known (""), the words of each stand in its place.
    """

    def led(found: re.Match[str]) -> str:
        mark, words, path = found.groups()
        if not address:
            return words
        return f"{mark}[{words}]({address}/{'raw' if mark else 'blob'}/HEAD/{path})"

    return BESIDE.sub(led, page)


class PageHook(MetadataHookInterface):
    """Gives the package README.md for its page, with the `address` of pyproject.toml."""

    def update(self, metadata: dict[str, Any]) -> None:
        page = Path(self.root, "README.md").read_text(encoding="utf-8")
        text = portable(page, str(self.config["address"]))
        metadata["readme"] = {"content-type": "text/markdown", "text": text}


class VendoredHook(BuildHookInterface[Any]):
    """Refuses a package whose page would be empty; an editable install may go without."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:  # noqa: ARG002
        """Raise `RuntimeError` where files are missing."""
        if version == "editable":
            return
        sys.path.insert(0, str(Path(__file__).resolve().parent))
        from fetch import missing  # type: ignore[import-not-found]

        if lacking := missing():
            raise RuntimeError(
                f"the console's JavaScript is not there: {', '.join(lacking)}: run `make page`"
            )

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:  # noqa: ARG002
        """Add the folders' links in `.namespace` to an sdist: hatchling knows files only."""
        if self.target_name != "sdist":
            return
        path = Path(artifact_path)
        content = io.BytesIO(gzip.decompress(path.read_bytes()))
        with tarfile.open(fileobj=content, mode="a", format=tarfile.PAX_FORMAT) as archive:
            top, first = archive.getnames()[0].split("/")[0], archive.getmembers()[0]
            for link in sorted(Path(self.root).glob(".namespace/*/*")):
                if link.is_symlink() and link.is_dir():
                    member = tarfile.TarInfo(f"{top}/{link.relative_to(self.root)}")
                    member.type, member.linkname = tarfile.SYMTYPE, str(link.readlink())
                    member.mtime = first.mtime
                    archive.addfile(member)
        path.write_bytes(gzip.compress(content.getvalue(), mtime=int(first.mtime)))
