"""The two shipped arms, and a run of the control computation on drives that follow at once."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from telerobot.config.load import Cell, altered, load_cell, shipped
from telerobot.server.control.arm import Arm as ArmControl
from telerobot.server.control.bodies.rates import ArmTick
from telerobot.server.control.inputs import Inputs, Intent, Settings, StickCommand
from telerobot.server.control.mechanism.model import Mechanism
from telerobot.server.control.parameters import Parameters
from telerobot.server.control.spatial import Array, Pose
from telerobot.server.control.tick import Control

SOURCES = ("joystick", "position", "vision", "force")


@dataclass(frozen=True)
class Arm:
    """One shipped cell, as the control computation sees it."""

    cell: Cell
    p: Parameters
    mechanism: Mechanism
    control: Control
    settings: Settings

    def posture(self, name: str) -> Array:
        return np.array(self.cell.config.mechanism.postures[name])

    def random_posture(self, rng: np.random.Generator) -> Array:
        return rng.uniform(
            np.maximum(self.p.joints.lower, -np.pi), np.minimum(self.p.joints.upper, np.pi)
        )

    def gains(self, **of: float | Array) -> dict[str, Array]:
        """Return the cell's gains, with those of some sources replaced."""
        return {**self.settings.gains, **{k: np.ones(6) * v for k, v in of.items()}}


@dataclass
class Run:
    """A run of one arm: what was commanded, tick by tick."""

    arm: Arm
    q: Array
    outputs: list[ArmTick] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.settings = self.arm.settings
        self.memory = self.arm.control.seed(self.q)
        self.sent = [self.q] * 3

    def tick(self, **inputs: object) -> ArmTick:
        """Do one period; the joints are where they were told to be, unless said otherwise."""
        given = {
            "time_s": len(self.outputs) * self.arm.p.period_s,
            "intent": Intent.MOVE,
            "q_measured": self.memory.commanded.sent[1],
            "settings": self.settings,
        }
        inputs = (Inputs(**{**given, **inputs}),)
        self.memory, (output,) = self.arm.control.tick(self.memory, inputs)
        self.outputs.append(output)
        self.sent.append(output.q)
        return output

    def go(self, seconds: float, **inputs: object) -> ArmTick:
        """Do periods for a while with the same inputs; return the last output."""
        for _ in range(round(seconds / self.arm.p.period_s)):
            output = self.tick(**inputs)
        return output

    def set(self, **settings: object) -> None:
        self.settings = replace(self.settings, **settings)

    @property
    def pose(self) -> Pose:
        """Where the command has the MRF."""
        q = self.memory.commanded.motion.q
        return self.arm.mechanism.pose_wrist(q) @ self.settings.T_wrist_mrf

    def observe(self) -> None:
        """Judge the whole run from the postures sent alone, as an observer on the bus would."""
        q, joints, T = np.array(self.sent), self.arm.p.joints, self.arm.p.period_s
        assert np.isfinite(q).all()
        assert (q >= np.minimum(joints.lower, self.q) - 1e-9).all()
        assert (q <= np.maximum(joints.upper, self.q) + 1e-9).all()
        for order, bound in enumerate((joints.velocity, joints.acceleration, joints.jerk), start=1):
            worst = (np.abs(np.diff(q, order, axis=0)) / (bound * T**order)).max()
            assert worst <= 1.0 + 1e-5, f"derivative {order}: {worst} of its bound"
        assert [o.refusal for o in self.outputs if o.refusal is not None] == []


def stick(*twist: float, axes: Array | None = None) -> StickCommand:
    """Return a stick twist (6,), in World axes unless said otherwise."""
    return StickCommand(np.array(twist), np.eye(3) if axes is None else axes)


def _arm(name: str) -> Arm:
    # Joints are led here as quickly as drives go: what a tool's own bound takes has tests apart.
    cell = altered(load_cell(name), {"limits.jog_speed": 10.0, "limits.posture_speed": 10.0})
    p, mechanism = Parameters.from_cell(cell), Mechanism.from_cell(cell)
    m, sources = cell.config.mechanism, cell.config.sources
    settings = Settings(
        gains={s: np.array(getattr(sources, s).gain) for s in SOURCES},
        T_wrist_mrf=Pose.from_xyz_rpy(m.T_wrist_mrf.xyz, m.T_wrist_mrf.rpy),
        T_world_crf=Pose.identity(),
        wrench_bias=np.zeros(6),
    )
    return Arm(cell, p, mechanism, Control([ArmControl(p, mechanism)]), settings)


@pytest.fixture(scope="session")
def pa10() -> Arm:
    """Return the seven-joint arm."""
    return _arm("pa10")


@pytest.fixture(scope="session")
def ur5e() -> Arm:
    """Return the six-joint arm."""
    return _arm("ur5e")


# Other cells are these arms once more; ranger's eight joints have tests of their own.
@pytest.fixture(params=[name for name in shipped("cells") if name in ("pa10", "ur5e")])
def arm(request: pytest.FixtureRequest) -> Arm:
    """Return each shipped arm in turn."""
    return _arm(request.param)


@pytest.fixture
def run(arm: Arm) -> Run:
    """Return a run of each arm from its posture `ready`."""
    return Run(arm, arm.posture("ready"))


@pytest.fixture(scope="session")
def start() -> Callable[..., Run]:
    """Return what starts a run of an arm from a posture, by name or joint angles."""

    def begin(arm: Arm, q: str | Array = "ready") -> Run:
        return Run(arm, arm.posture(q) if isinstance(q, str) else q)

    return begin


@pytest.fixture(name="stick", scope="session")
def _stick() -> Callable[..., StickCommand]:
    """Return what makes a stick's command."""
    return stick


@pytest.fixture
def rng() -> np.random.Generator:
    """Return the same random numbers in every run."""
    return np.random.default_rng(1997)


def random_pose(rng: np.random.Generator, reach: float = 1.0) -> Pose:
    """Return a pose of uniform attitude, by a unit quaternion."""
    w, x, y, z = (lambda v: v / np.linalg.norm(v))(rng.normal(size=4))
    R = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    return Pose(R, rng.uniform(-reach, reach, 3))


@pytest.fixture(name="random_pose")
def _random_pose(rng: np.random.Generator) -> Callable[[], Pose]:
    """Return what makes random poses."""
    return lambda reach=1.0: random_pose(rng, reach)
