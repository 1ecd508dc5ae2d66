"""Writes a clip as BVH, so that the reader can be tested with motions that are known exactly."""

import numpy as np
from scipy.spatial.transform import Rotation

from motion_data.skeleton import BODY_NAMES, kinematics, load_model

MIXAMO = {
    "pelvis": "mixamorig:Hips",
    "torso": "mixamorig:Spine",
    "head": "mixamorig:Neck",
    "skull": "mixamorig:Head",
    "right_upper_arm": "mixamorig:RightArm",
    "right_lower_arm": "mixamorig:RightForeArm",
    "right_hand": "mixamorig:RightHand",
    "left_upper_arm": "mixamorig:LeftArm",
    "left_lower_arm": "mixamorig:LeftForeArm",
    "left_hand": "mixamorig:LeftHand",
    "right_thigh": "mixamorig:RightUpLeg",
    "right_shin": "mixamorig:RightLeg",
    "right_foot": "mixamorig:RightFoot",
    "right_toe": "mixamorig:RightToeBase",
    "left_thigh": "mixamorig:LeftUpLeg",
    "left_shin": "mixamorig:LeftLeg",
    "left_foot": "mixamorig:LeftFoot",
    "left_toe": "mixamorig:LeftToeBase",
}
UNREAL = {
    "pelvis": "pelvis",
    "torso": "spine_01",
    "head": "neck_01",
    "skull": "head",
    **{
        f"{side}_{ours}": f"{theirs}_{side[0]}"
        for side in ("right", "left")
        for ours, theirs in (
            ("upper_arm", "upperarm"),
            ("lower_arm", "lowerarm"),
            ("hand", "hand"),
            ("thigh", "thigh"),
            ("shin", "calf"),
            ("foot", "foot"),
            ("toe", "ball"),
        )
    },
}
_EXTRA = {
    "skull": ("head", (0, 0, 0.165)),
    "right_toe": ("right_foot", (0.1, 0, -0.05)),
    "left_toe": ("left_foot", (0.1, 0, -0.05)),
}
_Y_UP = np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]], float)  # our x, y, z (forward, left, up) to theirs


def write_bvh(path, clip, names=MIXAMO, order="ZXY", up="y", unit=100.0, skip=(), twisted=False):
    """Writes the clip; ``unit`` is the file's units per metre, ``order`` that of the rotation channels.

    ``twisted`` gives every joint axes of its own, so that the pose with all angles zero is no standing pose (as in LaFAN).
    """
    model = load_model()
    axes = _Y_UP if up == "y" else np.eye(3)
    pose = kinematics(clip.qpos)
    world = Rotation.from_quat(pose.quaternions.reshape(-1, 4), scalar_first=True).as_matrix().reshape(-1, 15, 3, 3)
    children, offsets, local = {}, {}, {}
    for index, body in enumerate(BODY_NAMES):
        parent = model.body_parentid[index + 1] - 1
        offsets[body] = axes @ model.body_pos[index + 1]
        turn = world[:, index]
        if parent >= 0:
            children.setdefault(BODY_NAMES[parent], []).append(body)
            turn = np.swapaxes(world[:, parent], 1, 2) @ turn
        local[body] = axes @ turn @ axes.T
    for name, (parent, offset) in _EXTRA.items():
        if name not in skip:
            children.setdefault(parent, []).append(name)
            offsets[name], local[name] = axes @ np.array(offset, float), np.tile(np.eye(3), (len(clip), 1, 1))
    if twisted:
        bases = dict(zip(offsets, Rotation.random(len(offsets), rng=np.random.default_rng(0)).as_matrix(), strict=True))
        parent_of = {child: parent for parent, names_below in children.items() for child in names_below}
        for name in offsets:
            above = bases[parent_of[name]] if name in parent_of else np.eye(3)
            offsets[name] = above.T @ offsets[name]
            local[name] = above.T @ local[name] @ bases[name]
    lines, columns = ["HIERARCHY"], []

    def write(name, depth):
        tab = "\t" * depth
        kind = "JOINT" if depth else "ROOT"
        position = "" if depth else "Xposition Yposition Zposition "
        offset = offsets[name] * unit if depth else np.zeros(3)
        lines.extend(
            [f"{tab}{kind} {names[name]}", tab + "{", f"{tab}\tOFFSET " + " ".join(f"{x:.6f}" for x in offset)]
        )
        rotations = " ".join(f"{axis}rotation" for axis in order)
        lines.append(f"{tab}\tCHANNELS {3 if depth else 6} {position}{rotations}")
        if not depth:
            columns.append(pose.positions[:, 0] @ axes.T * unit)
        columns.append(Rotation.from_matrix(local[name]).as_euler(order, degrees=True))
        for child in children.get(name, []):
            write(child, depth + 1)
        if name not in children:
            lines.extend([f"{tab}\tEnd Site", tab + "\t{", f"{tab}\t\tOFFSET 0 0 0", tab + "\t}"])
        lines.append(tab + "}")

    write("pelvis", 0)
    lines.extend(["MOTION", f"Frames: {len(clip)}", f"Frame Time: {1 / clip.fps:.8f}"])
    lines.extend(" ".join(f"{value:.6f}" for value in row) for row in np.concatenate(columns, 1))
    path.write_text("\n".join(lines) + "\n")
    return path
