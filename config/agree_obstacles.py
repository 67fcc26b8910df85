"""What must agree between a cell's obstacles, its cameras and what may touch what."""

from collections.abc import Iterator

from .errors import nearest
from .schema import CellConfig


def obstacle_disagreements(config: CellConfig) -> Iterator[str]:
    """Yield what does not fit, each in one line with its key."""
    names = [o.name for o in config.obstacles]
    cameras = [c.name for c in config.cameras]
    on_base = [c.name for c in config.cameras if c.on == "base"]
    for i, obstacle in enumerate(config.obstacles):
        if obstacle.name in names[:i]:
            yield f"obstacles[{i}].name: value '{obstacle.name}': is there already"
        if obstacle.camera in on_base:
            yield (
                f"obstacles[{i}].camera: value '{obstacle.camera}': stands on Base: a sight line "
                "begins at a camera with T_wrist_lens or T_world_lens"
            )
        if obstacle.camera is not None and obstacle.camera not in cameras:
            hint = nearest(obstacle.camera, cameras)
            yield (
                f"obstacles[{i}].camera: value '{obstacle.camera}': no such camera in "
                f"[[cameras]]{hint}"
            )
    avoidance = config.avoidance
    near, promised = avoidance.near_distance, avoidance.clearance + avoidance.margin
    if avoidance.near_speed is not None and near <= promised:
        yield (
            f"avoidance.near_distance: value {near:g}: must be above {promised:g}, clearance and "
            "margin"
        )
