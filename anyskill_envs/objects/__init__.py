"""Objects that a scene can hold beside the humanoid; docs/objects.md says how to add one.

This file is the table of their names. An object's own file is read when the object is first asked for.
"""

from __future__ import annotations

import importlib

from anyskill_envs.objects.base import Placement, SceneObject

__all__ = ["Placement", "SceneObject", "load_object", "object_names", "register_object"]

_OBJECTS: dict[str, str | SceneObject] = {
    "ball": "anyskill_envs.objects.ball:BALL",
    "chair": "anyskill_envs.objects.chair:CHAIR",
    "door": "anyskill_envs.objects.door:DOOR",
    "latched_door": "anyskill_envs.objects.door:LATCHED_DOOR",
    "pillar": "anyskill_envs.objects.pillar:PILLAR",
}


def object_names() -> list[str]:
    """Names that `load_object` knows, sorted."""
    return sorted(_OBJECTS)


def register_object(item: SceneObject) -> None:
    """Make an object known by its name, for `gym.make(..., objects=[name])`.

    Raises:
        ValueError: the name is taken.
    """
    if item.name in _OBJECTS:
        raise ValueError(f"An object named {item.name!r} exists already; choose another name.")
    _OBJECTS[item.name] = item


def load_object(item: str | SceneObject) -> SceneObject:
    """An object by its name, or itself.

    Raises:
        ValueError: no object has this name; the message lists those that exist.
    """
    if isinstance(item, SceneObject):
        return item
    if item not in _OBJECTS:
        raise ValueError(f"Unknown object {item!r}; the objects that exist are: {', '.join(object_names())}.")
    found = _OBJECTS[item]
    if isinstance(found, str):
        module, _, name = found.partition(":")
        found = getattr(importlib.import_module(module), name)
        assert isinstance(found, SceneObject)
    return found
