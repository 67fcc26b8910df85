"""A running cell in the schemas that Foxglove, PlotJuggler and Rerun know: Foxglove's protobuf.

Frames are those of the URDF's links, `World`, and the MRF; with several arms a link's name begins
with its mechanism's.
"""

from collections.abc import Iterator
from importlib.util import find_spec
from typing import Any, Final

import numpy as np

from ....config.load import Cell, ConfigError
from ....protocols.messages.perception import ScanPoints
from ....protocols.messages.telemetry import Event, State
from ....server.control.proximity.capsules import Forest
from ....server.control.spatial import Array, Pose

WORLD: Final = "World"
LEVELS: Final = {"info": "INFO", "warning": "WARNING", "error": "ERROR"}
"""Foxglove's levels of a log line, by an event's severity."""


def require_schemas() -> None:
    """Raise `ConfigError` where Foxglove's schemas are not installed."""
    if find_spec("foxglove_schemas_protobuf") is None:
        raise ConfigError("recording needs Foxglove's schemas: pip install 'telerobot[record]'")


class Viewer:
    """Turns what a cell tells into messages for viewers."""

    def __init__(self, cell: Cell) -> None:
        """Build it. Raises `ConfigError` where the schemas are missing."""
        require_schemas()
        self._cell = cell
        self._branches = Forest(cell).branches

    def of_state(self, state: State, stamp_ns: int) -> Iterator[tuple[str, Any]]:
        """Yield topic and message of a state: joints and frames."""
        yield "joint_states", self._joints(state, stamp_ns)
        yield "tf", self._frames(state, stamp_ns)

    def of_event(self, event: Event, stamp_ns: int) -> tuple[str, Any]:
        """Return topic and message of an event: a line of a log."""
        from foxglove_schemas_protobuf.Log_pb2 import Log

        words = f"{event.name}: {event.detail}" if event.detail else event.name
        log = Log(
            level=Log.Level.Value(LEVELS[event.severity]),
            message=words,
            name=self._cell.config.name,
        )
        log.timestamp.FromNanoseconds(stamp_ns)
        return "log", log

    def of_picture(self, camera: str, data: bytes, stamp_ns: int) -> tuple[str, Any]:
        """Return topic and message of a PNG picture of a camera."""
        from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage

        image = CompressedImage(frame_id=camera, data=data, format="png")
        image.timestamp.FromNanoseconds(stamp_ns)
        return f"pictures/{camera}", image

    def of_scan(self, scan: ScanPoints, stamp_ns: int) -> tuple[str, Any]:
        """Return topic and message of a laser scan's points: a cloud in World."""
        from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
        from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud

        points = np.frombuffer(scan.points_mm, "<i4").reshape(-1, 3)
        cloud = PointCloud(
            frame_id=WORLD,
            point_stride=12,
            fields=[
                PackedElementField(name=axis, offset=4 * i, type=PackedElementField.FLOAT32)
                for i, axis in enumerate("xyz")
            ],
            data=(1e-3 * points).astype("<f4").tobytes(),
        )
        cloud.pose.orientation.w = 1.0
        cloud.timestamp.FromNanoseconds(stamp_ns)
        return "points", cloud

    def _joints(self, state: State, stamp_ns: int) -> Any:
        from foxglove_schemas_protobuf.JointState_pb2 import JointState
        from foxglove_schemas_protobuf.JointStates_pb2 import JointStates

        rates = state.dq_command
        joints = [
            JointState(name=name, position=q, velocity=dq, effort=tau)
            for name, q, dq, tau in zip(self._cell.joints, state.q, rates, state.tau, strict=True)
        ]
        message = JointStates(joints=joints)
        message.timestamp.FromNanoseconds(stamp_ns)
        return message

    def _frames(self, state: State, stamp_ns: int) -> Any:
        from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
        from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms

        found, first, base = [], 0, state.frames.get("base")
        for branch in self._branches:
            q = np.array(state.q[first : first + branch.n])
            first += branch.n
            # Only the Base of an only arm moves.
            T_world_base = branch.T_world_base if base is None else _pose(base)
            for name, T in branch.links(q).items():
                found.append((f"{branch.prefix}{name}", T_world_base @ T))
        found.append(("MRF", _pose(state.pose_mrf_measured)))
        message = FrameTransforms()
        for name, T in found:
            transform = FrameTransform(parent_frame_id=WORLD, child_frame_id=name)
            transform.timestamp.FromNanoseconds(stamp_ns)
            place, turn = transform.translation, transform.rotation
            place.x, place.y, place.z = T.p.tolist()
            turn.x, turn.y, turn.z, turn.w = _quaternion(T.R)
            message.transforms.append(transform)
        return message


def _pose(six: tuple[float, ...]) -> Pose:
    return Pose.from_xyz_rpy(six[:3], six[3:])


def _quaternion(R: Array) -> tuple[float, float, float, float]:
    """Return x, y, z, w of a rotation (3, 3) (Shepperd 1978)."""
    diagonal = np.diagonal(R)
    parts = np.array([*diagonal, diagonal.sum()])
    i = int(parts.argmax())
    if i == 3:
        q = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], 1.0 + parts[3]])
    else:
        j, k = (i + 1) % 3, (i + 2) % 3
        q = np.empty(4)
        q[i] = 1.0 + 2.0 * R[i, i] - parts[3]
        q[j], q[k] = R[j, i] + R[i, j], R[k, i] + R[i, k]
        q[3] = R[k, j] - R[j, k]
    x, y, z, w = (q / np.linalg.norm(q)).tolist()
    return x, y, z, w


def picture_in(data: bytes) -> bytes:
    """Return the PNG of a recorded picture. Raises `ConfigError` where the schemas are missing."""
    require_schemas()
    from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage

    picture: bytes = CompressedImage.FromString(data).data
    return picture
