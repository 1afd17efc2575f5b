"""The arm as bodies of MuJoCo, which moves, is loaded and touches: physics that nobody here wrote.

Nothing is added to a reading but the noise of the encoder. A soft joint is a spring between two
bodies, play is a gap between two bodies, an eccentric encoder is a disc off its axis under a head
that is fixed, a bent link is a bend of the body in the middle of the link.
"""

from __future__ import annotations

import mujoco
import numpy as np

from tests.drive.arm import BALL_KG, NOISE, PLAY, Arm
from tests.machines.arm import LIMITS
from tests.oracle import Array

MM = 1e-3
BALL = 0.01
"""Radius of the ball [m]."""
DISC = 0.03
"""Radius of the disc of an encoder [m]."""
ABOVE = {"cones": (0.04,), "plane": (0.1, 0.03)}
"""Heights from which a touch may begin [m]."""
DOWN = 1e-3
"""Between two looks whether the ball touches, on its way down [m]."""
PRESS = {"cones": 25.0, "plane": 3.0}
"""Force on the tool while it looks for its seat: a cone is found from its side [N]."""
LESS, REST = 3.0, 0.5
"""Force while the drives give way, and in the end [N]."""
SEATED = {"cones": 3, "plane": 1}
"""Contacts of a ball that sits."""
LOOKS = 30
"""Times that it is looked whether the ball sits, while the drives give way."""
FAR = 0.5
"""A joint that must turn more to lift the ball is near a posture that the arm keeps away from."""
SLIDES = 0.15
"""A joint that is pushed farther from where it should be slides over the table [rad]."""
STEP_S = 5e-4
GIVES = 0.02
"""Share of the way to where they are pushed that drives go in a turn of their control."""
FIRM = 300.0
"""Of the drives, which give way to the seat [N m/rad]."""


def document(arm: Arm) -> str:
    """The model of MuJoCo [m, kg]."""
    inner = f'<site name="tip" pos="{_text(arm.body.tool * MM)}"/>'
    inner += f'<body name="ball" pos="{_text(arm.body.tool * MM)}">' + _mass(BALL_KG, np.zeros(3))
    inner += f'<geom type="sphere" size="{BALL}" contype="1" conaffinity="1"/></body>'
    last = len(arm.body.rows) - 1
    for k in range(last, -1, -1):
        # From the joint of this row to what it carries: along the link, then its twist.
        inner = _way(arm, k, inner)
        row = arm.body.rows[k]
        own = _mass(row["mass"], np.array(row["com"]) * MM)
        disc = np.zeros(3)
        if (arm.kind, arm.joint) == ("eccentric", k):
            disc[:2] = arm.size * DISC * np.array([np.cos(arm.turn), np.sin(arm.turn)])
        encoder = f'<site name="disc{k}" pos="{_text(disc)}"/>'
        low, high = LIMITS[k]
        motor = (
            f'<joint name="m{k}" axis="0 0 1" limited="true" range="{low - 0.5} {high + 0.5}" '
            'armature="0.3" damping="5"/>'
        )
        if (arm.kind, arm.joint) == ("stiffness", k):
            stiff = arm.largest_torque / arm.size
            spring = f'<joint name="s{k}" axis="0 0 1" stiffness="{stiff}" damping="{stiff / 30}"/>'
            inner = f"{_mass(1e-3, np.zeros(3))}{encoder}<body>{spring}{own}{inner}</body>"
        elif (arm.kind, arm.joint) == ("backlash", k):
            gap = (
                f'<joint name="s{k}" axis="0 0 1" limited="true" range="{-arm.size} {arm.size}" '
                'damping="0.5" solreflimit="0.001 1" solimplimit="0.9999 0.9999 0.001"/>'
            )
            inner = f"{_mass(1e-3, np.zeros(3))}{encoder}<body>{gap}{own}{inner}</body>"
        else:
            inner = f"{own}{encoder}{inner}"
        inner = f'<site name="head{k}" pos="{DISC} 0 0"/><body name="b{k}">{motor}{inner}</body>'
    drives = "".join(f'<position joint="m{k}" kp="{FIRM}" dampratio="1"/>' for k in range(6))
    return f"""<mujoco><compiler angle="radian" autolimits="false"/>
<option timestep="{STEP_S}" integrator="implicitfast" cone="elliptic"/>
<default><geom contype="0" conaffinity="0" condim="1" solref="0.002 1"
 solimp="0.999 0.9999 0.0001"/></default>
<worldbody>{inner}{_held(arm)}</worldbody><actuator>{drives}</actuator></mujoco>"""


def _way(arm: Arm, k: int, inner: str) -> str:
    """The link after a joint: half of it, its bend, the other half, its twist."""
    row = arm.body.rows[k]
    half = np.array([row.get("a", 0.0), 0.0, row.get("d", 0.0)]) * MM / 2
    bend = np.array([1.0, 0.0, 0.0, 0.0])
    if (arm.kind, arm.joint) == ("bent", k):
        axis = np.array([np.cos(arm.turn), np.sin(arm.turn), 0.0])
        bend = np.r_[np.cos(arm.size / 2), np.sin(arm.size / 2) * axis]
    twist = row.get("alpha", 0.0) / 2
    turned = np.array([np.cos(twist), np.sin(twist), 0.0, 0.0])
    middle = f'<body pos="{_text(half)}" quat="{_text(turned)}">{inner}</body>'
    return f'<body pos="{_text(half)}" quat="{_text(bend)}">{middle}</body>'


def _held(arm: Arm) -> str:
    """What the ball touches: cones of three faces each, or a table; each moves by its play."""
    out = ""
    for name, at in arm.places.items():
        faces = ""
        if arm.touch == "plane":
            faces = f'<geom type="box" size="2 2 0.05" pos="0 0 {-BALL - 0.05}" contype="1"/>'
        for third in range(3 if arm.touch == "cones" else 0):
            turn = 2 * np.pi * third / 3
            normal = np.array([np.cos(turn), np.sin(turn), 1.0]) / np.sqrt(2.0)
            axis = np.array([-np.sin(turn), np.cos(turn), 0.0])
            quat = np.r_[np.cos(np.pi / 8), np.sin(np.pi / 8) * axis]
            pos = -(BALL + 0.005) * normal
            faces += f'<geom type="box" size="0.04 0.04 0.005" pos="{_text(pos)}" '
            faces += f'quat="{_text(quat)}" contype="1"/>'
        out += f'<body name="{name}" mocap="true" pos="{_text(at * MM)}">{faces}</body>'
    return out


def _mass(mass: float, at: Array) -> str:
    wide = max(mass * 0.004, 1e-5)
    return f'<inertial mass="{mass}" pos="{_text(at)}" diaginertia="{wide} {wide} {wide}"/>'


def _text(values: Array) -> str:
    return " ".join(f"{v:.12g}" for v in values)


class Body:
    """The arm at work: goes to readings, presses its ball into its seat, and is read."""

    def __init__(self, arm: Arm, seed: int) -> None:
        self.arm = arm
        self.rng = np.random.default_rng([seed, 38])
        self.model = mujoco.MjModel.from_xml_string(document(arm))
        self.data = mujoco.MjData(self.model)
        names = [f"m{k}" for k in range(6)]
        self.at = np.array([self.model.joint(n).qposadr[0] for n in names])
        self.dof = np.array([self.model.joint(n).dofadr[0] for n in names])
        self.stands: Array | None = None
        """Angles of the motors where the arm came to stand."""
        self.beyond = 0
        """How often a motor was beyond its limits, on its straight ways and while it touches."""
        self.ball = self.model.body("ball").id

    def encoders(self) -> Array:
        """What the heads see of their discs, without noise (6,) [rad]."""
        out = np.empty(6)
        for k in range(6):
            turn = self.data.body(f"b{k}").xmat.reshape(3, 3)
            seen = turn.T @ (self.data.site(f"head{k}").xpos - self.data.site(f"disc{k}").xpos)
            angle = -np.arctan2(seen[1], seen[0])
            near = self.data.qpos[self.at[k]]
            out[k] = angle + 2 * np.pi * np.round((near - angle) / (2 * np.pi))
        return out - self.arm.offsets

    def read(self, samples: int) -> Array:
        """Readings of all joints, (samples, 6)."""
        return self.encoders() + NOISE * self.rng.standard_normal((samples, 6))

    def touch(self, goal: Array) -> bool:
        """Go to readings from above, and press the ball into its seat; whether it sits."""
        self._play()
        start = self._above(goal + self.arm.offsets)
        if start is None:
            return False  # it has not moved
        lifted, goal = start
        if self.stands is not None:
            self.beyond += self._beyond(np.linspace(self.stands, goal, 100))
        self.data.ctrl[:] = goal
        self._place(lifted)
        way = (goal, SLIDES + float(np.abs(lifted - goal).max()))
        held = self._run(0.9, PRESS[self.arm.touch], way)
        self.data.ctrl[:] = self.data.qpos[self.at]  # the cone knows better where the ball is
        for _ in range(LOOKS):
            held = held and self._run(0.4, LESS, way, gives=True)
            if not held or self.data.ncon == SEATED[self.arm.touch]:
                break
        held = held and self._run(0.4, REST, way, gives=True)
        mujoco.mj_forward(self.model, self.data)
        self.stands = np.array(self.data.qpos[self.at])
        return held and bool(self.data.ncon == SEATED[self.arm.touch])

    def _play(self) -> None:
        """Where the ball sits this time."""
        for k, at in enumerate(self.arm.places.values()):
            self.data.mocap_pos[k] = (at + PLAY * self.rng.standard_normal(3)) * MM

    def _place(self, motors: Array) -> None:
        """Stand at angles of the motors, at rest."""
        self.data.qpos[:], self.data.qvel[:] = 0.0, 0.0
        self.data.qpos[self.at] = motors
        mujoco.mj_forward(self.model, self.data)

    def slopes(self) -> Array:
        """Derivative of the place of the ball by the motors: (3, 6) [m/rad]."""
        whole = np.zeros((3, self.model.nv))
        mujoco.mj_jacSite(self.model, self.data, whole, None, self.model.site("tip").id)
        return np.asarray(whole[:, self.dof])

    def _above(self, goal: Array) -> tuple[Array, Array] | None:
        """Where a touch begins, and what its drives hold: angles of the motors; None: nowhere.

        Onto a table the arm goes down until it touches, wherever the table was thought to be.
        """
        for height in ABOVE[self.arm.touch]:
            self._place(goal)
            lifted = self._lifted(height)
            if np.abs(lifted - goal).max() > FAR or self._beyond(lifted[None]) or self.data.ncon:
                continue
            if self.arm.touch == "cones":
                return lifted, goal
            for _ in range(int(2 * height / DOWN)):
                before = np.array(self.data.qpos[self.at])
                if self._beyond(before[None]) or np.abs(before - goal).max() > FAR:
                    break
                self._place(before - np.linalg.pinv(self.slopes(), 1e-3)[:, 2] * DOWN)
                if self.data.ncon:
                    return before, before
        return None

    def _lifted(self, height: float) -> Array:
        """Angles of the motors with the ball above where it is now."""
        wanted = self.data.site("tip").xpos + [0.0, 0.0, height]
        for _ in range(10):
            off = wanted - self.data.site("tip").xpos
            self._place(self.data.qpos[self.at] + np.linalg.pinv(self.slopes(), 1e-3) @ off)
        return np.array(self.data.qpos[self.at])

    def _run(
        self, seconds: float, press: float, way: tuple[Array, float], gives: bool = False
    ) -> bool:
        """Let time pass: drives hold against the weights, the tool is pressed down.

        Drives that give follow where the tool is pushed. The way is a goal, and how far from it a
        joint may be: where it is farther, the robot stops. Whether it went on to the end.
        """
        goal, far = way
        chunk = 8
        for _ in range(int(seconds / STEP_S / chunk)):
            if gives:
                self.data.ctrl += GIVES * (self.data.qpos[self.at] - self.data.ctrl)
            self.data.qfrc_applied[self.dof] = self.data.qfrc_bias[self.dof]
            self.data.xfrc_applied[self.ball] = [0.0, 0.0, -press, 0.0, 0.0, 0.0]
            mujoco.mj_step(self.model, self.data, chunk)
            self.beyond += self._beyond(self.data.qpos[self.at][None])
            if np.abs(self.data.qpos[self.at] - goal).max() > far:
                return False
        return True

    def _beyond(self, motors: Array) -> int:
        """How many of so many angles of motors, (n, 6), are beyond what the encoders may read."""
        read, ends = motors - self.arm.offsets, np.array(LIMITS)
        return int(np.sum(np.any((read < ends[:, 0]) | (read > ends[:, 1]), axis=1)))
