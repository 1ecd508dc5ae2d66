"""Writes clips as ASF/AMC and AMASS files, so that the readers can be tested with motions that are known exactly."""

import numpy as np
from scipy.spatial.transform import Rotation

from motion_data.skeleton import body_index, kinematics, load_model

_Y_UP = np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]], float)  # our x, y, z (forward, left, up) to theirs


def _place(body):
    return load_model().body(body).pos


def _bones():
    """(name, parent, body it turns with, end in the frame of that body, whether it may turn)."""
    yield "lowerback", "root", "pelvis", _place("torso"), False
    yield "thorax", "lowerback", "torso", _place("head"), True
    yield "lowerneck", "thorax", "head", (0, 0, 0.05), True
    yield "head", "lowerneck", "head", (0, 0, 0.15), False
    for side in ("right", "left"):
        s = side[0]
        yield f"{s}clavicle", "lowerback", "torso", _place(f"{side}_upper_arm"), True
        yield f"{s}humerus", f"{s}clavicle", f"{side}_upper_arm", _place(f"{side}_lower_arm"), True
        yield f"{s}radius", f"{s}humerus", f"{side}_lower_arm", _place(f"{side}_hand"), True
        yield f"{s}hand", f"{s}radius", f"{side}_lower_arm", (0, 0, -0.08), False
        yield f"{s}hipjoint", "root", "pelvis", _place(f"{side}_thigh"), False
        yield f"{s}femur", f"{s}hipjoint", f"{side}_thigh", _place(f"{side}_shin"), True
        yield f"{s}tibia", f"{s}femur", f"{side}_shin", _place(f"{side}_foot"), True
        yield f"{s}foot", f"{s}tibia", f"{side}_foot", (0.1, 0, -0.05), True
        yield f"{s}toes", f"{s}foot", f"{side}_foot", (0.03, 0, 0), False


def _orientations(clip):
    pose = kinematics(clip.qpos)
    turns = Rotation.from_quat(pose.quaternions.reshape(-1, 4), scalar_first=True).as_matrix()
    return pose.positions[:, 0], turns.reshape(len(clip), -1, 3, 3)


def write_acclaim(folder, clip, name="02_01", subject="02", inches=True):
    """Writes ``subject.asf`` and ``name.amc``, y up, every bone with axes of its own; returns the AMC file."""
    unit = 0.45 / 0.0254 if inches else 1.0
    root, turns = _orientations(clip)
    rng = np.random.default_rng(0)
    bodies, axes, bones, tree = {"root": "pelvis"}, {"root": np.eye(3)}, [], {}
    columns = {"root": np.concatenate([root @ _Y_UP.T * unit, _angles(turns[:, 0], np.eye(3))], 1)}
    for bone, parent, body, end, moves in _bones():
        angles = rng.uniform(-90, 90, 3).round(3)
        bodies[bone], axes[bone] = body, Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
        tree.setdefault(parent, []).append(bone)
        direction = _Y_UP @ np.asarray(end, float)
        length = np.linalg.norm(direction)
        bones += [
            "  begin",
            f"     name {bone}",
            "     direction " + " ".join(f"{x:.8f}" for x in direction / length),
            f"     length {length * unit:.8f}",
            "     axis " + " ".join(map(str, angles)) + "  XYZ",
        ]
        if moves:
            bones += ["    dof rx ry rz", "    limits (-180.0 180.0)", "           (-90 90)", "           (-90 90)"]
            against = turns[:, body_index(bodies[parent])]
            columns[bone] = _angles(np.swapaxes(against, 1, 2) @ turns[:, body_index(body)], axes[bone])
        bones.append("  end")
    asf = [
        "# written by a test",
        ":version 1.10",
        ":name TEST",
        ":units",
        "  mass 1.0",
        "  length 0.45",
        "  angle deg",
        ":documentation",
        "   none",
        ":root",
        "   order TX TY TZ RX RY RZ",
        "   axis XYZ",
        "   position 0 0 0",
        "   orientation 0 0 0",
        ":bonedata",
        *bones,
        ":hierarchy",
        "  begin",
        *("    " + " ".join([parent, *children]) for parent, children in tree.items()),
        "  end",
    ]
    (folder / f"{subject}.asf").write_text("\n".join(asf) + "\n")
    amc = ["#!OML:ASF", ":FULLY-SPECIFIED", ":DEGREES"]
    for frame in range(len(clip)):
        amc.append(str(frame + 1))
        amc += [f"{bone} " + " ".join(f"{x:.6f}" for x in rows[frame]) for bone, rows in columns.items()]
    path = folder / f"{name}.amc"
    path.write_text("\n".join(amc) + "\n")
    return path


def _angles(local, axes):
    turn = axes.T @ (_Y_UP @ local @ _Y_UP.T) @ axes
    return Rotation.from_matrix(turn).as_euler("xyz", degrees=True)


# SMPL's 22 body joints: parent and the body of ours that turns alike.
_SMPL = (
    (-1, "pelvis"),
    (0, "left_thigh"),
    (0, "right_thigh"),
    (0, "pelvis"),
    (1, "left_shin"),
    (2, "right_shin"),
    (3, "torso"),
    (4, "left_foot"),
    (5, "right_foot"),
    (6, "torso"),
    (7, "left_foot"),
    (8, "right_foot"),
    (9, "head"),
    (9, "torso"),
    (9, "torso"),
    (12, "head"),
    (13, "left_upper_arm"),
    (14, "right_upper_arm"),
    (16, "left_lower_arm"),
    (17, "right_lower_arm"),
    (18, "left_lower_arm"),
    (19, "right_lower_arm"),
)


def write_amass(path, clip, width=156, rate="mocap_framerate"):
    """Writes the clip as AMASS does: z up, SMPL's T-pose as the pose without rotations."""
    root, turns = _orientations(clip)
    world = []
    for _, body in _SMPL:
        # Our arms hang where SMPL's are stretched out.
        lowered = {"left": -90, "right": 90}[body.split("_")[0]] if "arm" in body else 0
        rest = Rotation.from_euler("x", lowered, degrees=True).as_matrix()
        world.append(turns[:, body_index(body)] @ rest @ _Y_UP.T)
    poses = np.zeros((len(clip), width))
    for joint, (parent, _) in enumerate(_SMPL):
        local = world[joint] if parent < 0 else np.swapaxes(world[parent], 1, 2) @ world[joint]
        poses[:, 3 * joint : 3 * joint + 3] = Rotation.from_matrix(local).as_rotvec()
    arrays = {"poses": poses, "trans": root, rate: np.array(clip.fps), "betas": np.zeros(16), "gender": "neutral"}
    np.savez(path, **arrays)
    return path
