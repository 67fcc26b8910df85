"""Fail if a wheel lacks a file that the package reads, or carries one that is not the package's."""

import sys
import zipfile
from pathlib import Path

FOLDERS = ("config", "drivers", "protocols", "server", "tools")
DATA = (".toml", ".urdf", ".eds", ".js", ".css", ".html", ".svg", ".service", ".template")
UNSHIPPED = {"node_modules", "pictures"}
"""Folders that no wheel holds: pictures are the pages', which are read in the repository."""

root = Path(__file__).resolve().parents[1]
wanted = {"telerobot/__init__.py", "telerobot/py.typed"}
for folder in FOLDERS:
    for path in (root / folder).rglob("*"):
        if path.suffix in (".py", *DATA) and UNSHIPPED.isdisjoint(path.parts):
            wanted.add(f"telerobot/{path.relative_to(root).as_posix()}")
sys.path.insert(0, str(root / "vendor"))
from fetch import SERVED  # noqa: E402  the page's list of what it is served with, not the tree's

wanted |= {f"telerobot/tools/operator/web/static/vendor/{name}" for name in SERVED.values()}
names = set(zipfile.ZipFile(sys.argv[1]).namelist())
missing = sorted(wanted - names)
foreign = sorted(
    n
    for n in names
    if not n.startswith(("telerobot/", "telerobot-")) or not UNSHIPPED.isdisjoint(n.split("/"))
)
if missing or foreign:
    sys.exit(f"wheel: missing {missing}, foreign {foreign}")
print(f"{Path(sys.argv[1]).name}: {len(names)} files, all of the package's")
