"""Hook of hatchling: no package without the page's JavaScript; an sdist keeps the tree's links."""

import gzip
import io
import sys
import tarfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


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
