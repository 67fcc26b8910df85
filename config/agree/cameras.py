"""Agreement between a cell's cameras, the vision source, and the tags of the rig."""

from collections.abc import Iterator

from ..errors import nearest
from ..schema.cell import CellConfig
from ..schema.sensors.cameras import CameraSection, RigTagSection


def camera_disagreements(config: CellConfig) -> Iterator[str]:
    """Yield what does not fit, each in one line with its key."""
    names = [c.name for c in config.cameras]
    yield from _twice("cameras", names)
    wanted = config.sources.vision.camera
    if wanted is not None and wanted not in names:
        hint = nearest(wanted, names)
        yield f"sources.vision.camera: value '{wanted}': no such camera in [[cameras]]{hint}"
    if config.sources.vision.view is not None and not names:
        yield "sources.vision.view: there is no camera in [[cameras]]"
    tags = () if config.rig is None else config.rig.tags
    yield from _twice("rig.tags", [tag.name for tag in tags])
    for i, camera in enumerate(config.cameras):
        if camera.device is None:
            yield from _rendered(f"cameras[{i}]", camera, config.rig is not None, tags)


def _rendered(
    where: str, camera: CameraSection, rig: bool, tags: tuple[RigTagSection, ...]
) -> Iterator[str]:
    if not rig:
        yield f"{where}.device: missing: without [rig] a camera is opened, not rendered"
    width, height = camera.size
    middle = (width / 2 - 0.5, height / 2 - 0.5)
    if camera.focal[0] != camera.focal[1] or camera.centre != middle or any(camera.distortion):
        yield (
            f"{where}.focal: a rendered camera is a pinhole: one focal length, the principal point "
            "in the middle, no distortion"
        )
    for tag in tags:
        if (tag.tag, tag.family) == (camera.tag, camera.family) and tag.size != camera.tag_size:
            yield f"{where}.tag_size: value {camera.tag_size:g}: rig.tags has it as {tag.size:g}"


def _twice(where: str, names: list[str]) -> Iterator[str]:
    for i, name in enumerate(names):
        if name in names[:i]:
            yield f"{where}[{i}].name: value '{name}': is there already"
