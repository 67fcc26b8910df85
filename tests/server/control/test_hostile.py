"""Whatever goes in, what comes out is finite, bounded and continuous."""

import numpy as np
import pytest
from telerobot.config.schema.null_space import OBJECTIVES
from telerobot.server.control.inputs import (
    Intent,
    ObjectiveGains,
    PathGoal,
    Pursuit,
    Route,
    TwistRoute,
    TwistSegment,
)
from telerobot.server.control.spatial import Pose, rotation_rpy

SECONDS = 12.0


class Hostility:
    """Inputs that change at random, most of them far beyond what an arm can do."""

    def __init__(self, run, rng, stick):
        self.run, self.rng, self.stick = run, rng, stick
        self.inputs = {"intent": Intent.MOVE}
        self.serial = 0
        self.lag = np.zeros(run.arm.p.n)

    def tick(self):
        if self.rng.random() < 0.06:
            self.change()
        if self.rng.random() < 0.1:
            self.lag = self.rng.normal(size=len(self.lag)) * self.run.arm.p.joints.leash * 0.3
        return self.run.tick(**self.inputs, q_measured=self.run.memory.commanded.sent[1] - self.lag)

    def change(self):
        run, rng, inputs = self.run, self.rng, self.inputs
        p = run.arm.p
        match rng.integers(16):
            case 0 | 1:
                axes = rotation_rpy(*rng.uniform(-3, 3, 3))
                inputs["stick"] = self.stick(*rng.choice([-2, 0, 2], 6), axes=axes)
            case 2:
                inputs["stick"] = None
            case 3 | 4:
                self.serial += 1
                pose = Pose(rotation_rpy(*rng.uniform(-3, 3, 3)), rng.uniform(-1.5, 1.5, 3))
                speed = rng.choice([0.05, 0.5, 5.0])
                inputs["goal"] = PathGoal(pose, self.serial, float(speed))
            case 5:
                inputs["goal"] = None
            case 6:
                jog = rng.uniform(-p.joints.velocity, p.joints.velocity)
                inputs["jog"] = None if inputs.get("jog") is not None else jog
            case 7:
                posture = (
                    None
                    if inputs.get("posture") is not None
                    else rng.uniform(p.joints.lower, p.joints.upper)
                )
                inputs["posture"] = posture
            case 8:
                wrench = rng.normal(size=6) * [200, 200, 200, 20, 20, 20]
                inputs["wrench_sensor"] = None if rng.random() < 0.4 else wrench
            case 9:
                run.set(
                    gains=run.arm.gains(
                        joystick=rng.uniform(0, 2, 6),
                        position=rng.uniform(0, 5, 6),
                        force=rng.uniform(0, 1e-3, 6),
                    )
                )
            case 10:
                run.set(
                    speed_factor=float(rng.choice([0.02, 0.3, 1.0])),
                    T_wrist_mrf=Pose(
                        rotation_rpy(*rng.uniform(-3, 3, 3)), rng.uniform(-0.4, 0.4, 3)
                    ),
                )
            case 12:
                self.serial += 1
                legs = tuple(
                    PathGoal(Pose(rotation_rpy(*rng.uniform(-1, 1, 3)), p_), self.serial)
                    for p_ in run.pose.p + rng.uniform(-0.3, 0.3, (4, 3))
                )
                inputs["goal"] = Route(legs, self.serial, float(rng.choice([0.0, 0.05])))
            case 13:
                self.serial += 1
                segments = tuple(
                    TwistSegment(
                        rng.choice([-1, 0, 1], 6) * rng.uniform(0, 1), rng.uniform(0.01, 0.5)
                    )
                    for _ in range(5)
                )
                moving_axes = bool(rng.random() < 0.5)
                inputs["goal"] = TwistRoute(segments, self.serial, moving_axes)
            case 14:
                inputs["paused"] = not inputs.get("paused", False)
                if not isinstance(inputs.get("goal"), Pursuit):
                    self.serial += 1
                away = Pose(rotation_rpy(*rng.uniform(-1, 1, 3)), rng.uniform(-0.2, 0.2, 3))
                target = None if rng.random() < 0.3 else run.pose @ away
                inputs["goal"] = Pursuit(target, self.serial)
            case 15:
                gains = {name: float(rng.choice([0.0, 1.0])) * 10.0 for name in OBJECTIVES}
                gains["least_energy"] *= 0.1
                run.set(
                    objectives=ObjectiveGains(gains, rng.uniform(p.joints.lower, p.joints.upper))
                )
            case 11:
                # HOLD follows rest only, as in the daemon's modes.
                rest = run.outputs[-1].at_rest if run.outputs else False
                stopped = Intent.HOLD if rest else Intent.STOP
                moving = inputs["intent"] is Intent.MOVE
                inputs["intent"] = stopped if moving or rng.random() < 0.5 else Intent.MOVE


@pytest.mark.parametrize("seed", range(5))
def test_no_input_takes_a_command_beyond_any_bound(arm, start, stick, seed):
    rng = np.random.default_rng(seed)
    run = start(arm)
    hostility = Hostility(run, rng, stick)
    for _ in range(round(SECONDS / arm.p.period_s)):
        hostility.tick()
    run.observe()
    # It was no idle run.
    speeds = np.abs(np.diff(run.sent, axis=0)) / arm.p.period_s
    assert (speeds.max(axis=0) > 0.3 * arm.p.joints.velocity).any()


@pytest.mark.parametrize("seed", range(3))
def test_from_wherever_hostility_led_a_posture_leads_home(arm, start, stick, seed):
    rng = np.random.default_rng(100 + seed)
    run = start(arm)
    hostility = Hostility(run, rng, stick)
    for _ in range(500):
        hostility.tick()
    run.settings = arm.settings
    output = run.go(15.0, posture=arm.posture("ready"))
    assert output.at_goal
    run.observe()


@pytest.mark.parametrize("seed", range(4))
def test_from_wherever_hostility_led_the_arm_can_stop(arm, start, stick, seed):
    rng = np.random.default_rng(200 + seed)
    run = start(arm)
    hostility = Hostility(run, rng, stick)
    for _ in range(int(rng.integers(50, 500))):
        hostility.tick()
    output = run.go(3.0, intent=Intent.STOP)
    assert output.at_rest
    run.observe()


@pytest.mark.parametrize("name", ["q_measured", "wrench_sensor"])
def test_a_reading_that_is_not_a_number_never_gets_past_the_gate_in_silence(run, stick, name):
    run.go(0.2, stick=stick(0.05, 0, 0, 0, 0, 0))
    bad = np.full(run.arm.p.n if name == "q_measured" else 6, np.nan)
    try:
        output = run.tick(stick=stick(0.05, 0, 0, 0, 0, 0), **{name: bad})
    except Exception:  # noqa: BLE001  what is raised stops the arm one level up
        return
    assert output.refusal is not None or np.isfinite(output.q).all()
