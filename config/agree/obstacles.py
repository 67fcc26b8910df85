"""Agreement between a cell's obstacles, its cameras and what may touch what."""

from collections.abc import Iterator, Sequence

from ..errors import nearest
from ..schema.cell import CellConfig
from ..urdf.robot import Robot


def obstacle_disagreements(config: CellConfig) -> Iterator[str]:
    """Yield what does not fit, each in one line with its key."""
    names = [o.name for o in config.obstacles]
    cameras = [c.name for c in config.cameras]
    on_base = [c.name for c in config.cameras if c.on == "base"]
    carried = [c.name for c in config.cameras if c.T_wrist_lens is not None]
    for i, obstacle in enumerate(config.obstacles):
        if obstacle.name in names[:i]:
            yield f"obstacles[{i}].name: value '{obstacle.name}': is there already"
        if obstacle.camera in on_base:
            yield (
                f"obstacles[{i}].camera: value '{obstacle.camera}': stands on Base: a sight line "
                "begins at a camera with T_wrist_lens or T_world_lens"
            )
        if obstacle.camera in carried and obstacle.hard:
            yield (
                f"obstacles[{i}].hard: value True: the sight line of '{obstacle.camera}' moves "
                "with the arm: only one that begins at a standing camera can be a barrier"
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


def link_disagreements(config: CellConfig, robots: Sequence[tuple[str, Robot]]) -> Iterator[str]:
    """Yield what does not fit the links of a cell's arms, each with what their names begin with."""
    if config.keeps_clear:
        shaped = {link for c in config.avoidance.capsules for link in (c.link, *c.holds)}
        for prefix, robot in robots:
            for link in robot.unshaped_links():
                if f"{prefix}{link}" not in shaped:
                    yield (
                        f"avoidance.capsules: link '{prefix}{link}' of {robot.urdf} has mass but "
                        "no <collision>: nothing would keep it clear; give it capsules here"
                    )
            for link in robot.mesh_links():
                if f"{prefix}{link}" not in shaped:
                    yield (
                        f"avoidance.capsules: link '{prefix}{link}' of {robot.urdf} has a mesh, "
                        f"which is not read: give it capsules here, as `telerobot init "
                        f"{robot.urdf}` finds them"
                    )
    links = [f"{prefix}{link}" for prefix, robot in robots for link in robot.links()]
    named = [
        (f"avoidance.capsules[{i}].link", c.link) for i, c in enumerate(config.avoidance.capsules)
    ]
    named += [
        (f"avoidance.capsules[{i}].holds[{k}]", link)
        for i, capsule in enumerate(config.avoidance.capsules)
        for k, link in enumerate(capsule.holds)
    ]
    # What a link may touch can be an obstacle that only comes while the arm works.
    contacts = enumerate(config.avoidance.allowed_contacts)
    for i, pair in contacts:
        where = f"avoidance.allowed_contacts[{i}]"
        named += [(f"{where}.link", pair.link)]
        named += [(f"{where}.other", pair.other)] if "." in pair.other else []
    for where, link in named:
        if link not in links:
            files = ", ".join(sorted({str(robot.urdf) for _, robot in robots}))
            yield f"{where}: value '{link}': no such link in {files}{nearest(link, links)}"
