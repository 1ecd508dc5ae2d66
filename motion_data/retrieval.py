"""Databases of short clips for motion retrieval: made from any clips, searched by key, switched by name."""

import fnmatch
import hashlib
import importlib.metadata
import json
import logging
import re
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np

from motion_data.clip import MotionClip
from motion_data.files import write_whole
from motion_data.library import MotionLibrary, imports_folder
from motion_data.nearest import NearestKeys
from motion_data.readers import read_motion
from motion_data.retrieval_keys import (
    BLOCK_SCALE,
    CLIP_FRAMES,
    END_EFFECTOR_INDEX,
    KEY_LAYOUT,
    KEY_SIZE,
    SMALLEST_DEVIATION,
    STATE_SIZE,
    course_key,
    state_key,
)
from motion_data.skeleton import FRAME_RATE, heading, kinematics
from motion_data.window import WINDOW_FRAMES

_LOG = logging.getLogger(__name__)
_FORMAT_VERSION = 1
DEFAULT_SELECTION = "move_around&usual"
"""The library's locomotion, without acrobatics and crawling: a fast goal must not call up a cartwheel."""
_MOTION_SUFFIXES = (".bvh", ".amc", ".npz", ".json", ".txt")
_ARRAYS = ("qpos", "states", "lengths", "windows", "keys")


class MotionDatabase:
    """Clips of 0.5 s with their keys: RACon's database K:V, exactly searchable.

    Every frame of a clip that has 0.5 s after it begins one (or every `stride`-th). Looping clips are continued, so that
    each of their frames does. Keys are standardised, and each block of a key counts alike.

    Make one with :meth:`from_clips`, :meth:`from_folder`, :meth:`load` or :func:`find_database`.

    Args:
        names: Names of the motions, ``(motions,)``.
        lengths: Frames of each, ``(motions,)``.
        qpos: Poses of all, joined, ``(F, 35)``.
        states: The part of a key that each frame's state determines, ``(F, 27)``.
        windows: The frames that begin a clip, ``(W,)``.
        keys: Their keys in metres, seconds and radians, ``(W, 32)``.

    Attributes:
        mean: Mean of the keys, ``(32,)``.
        scale: What the difference to the mean is multiplied with, ``(32,)``.
        last: Last frame of the motion to which each frame belongs, ``(F,)``.
        motion_of_frame: Which motion that is, ``(F,)``.

    Raises:
        ValueError: If there is no clip.
    """

    def __init__(
        self,
        names: Sequence[str],
        lengths: np.ndarray,
        qpos: np.ndarray,
        states: np.ndarray,
        windows: np.ndarray,
        keys: np.ndarray,
    ):
        if not len(windows):
            raise ValueError("A motion database needs at least one clip; this one is empty.")
        self.names = tuple(names)
        self.lengths = np.asarray(lengths, np.int64)
        self.qpos = np.asarray(qpos, np.float32)
        self.states = np.asarray(states, np.float32)
        self.windows = np.asarray(windows, np.int64)
        self.keys = np.asarray(keys, np.float32)
        self.mean = self.keys.mean(0, dtype=np.float64)
        self.scale = BLOCK_SCALE / np.maximum(self.keys.std(0, dtype=np.float64), SMALLEST_DEVIATION)
        ends = np.cumsum(self.lengths)
        self.last = np.repeat(ends - 1, self.lengths)
        self.motion_of_frame = np.repeat(np.arange(len(self.names)), self.lengths)
        self._low, self._high = self.keys.min(0), self.keys.max(0)

    def __len__(self) -> int:
        """Number of clips of 0.5 s."""
        return len(self.windows)

    @cached_property
    def _nearest(self) -> NearestKeys:
        return NearestKeys((self.keys - self.mean) * self.scale)

    @property
    def speeds(self) -> np.ndarray:
        """Mean horizontal speed of each clip of 0.5 s, ``(W,)`` m/s."""
        return np.linalg.norm(self.keys[:, KEY_LAYOUT["mean_velocity"]], axis=1)

    def search(self, queries: np.ndarray, weights: np.ndarray | None = None, metric: bool = False) -> np.ndarray:
        """The clip whose key is nearest to each query.

        A query is held within the range of the keys, so that a goal which no clip comes near does not drown the pose,
        and standardised. Then either the query is weighted, Q = w * q (RACon: the keys are not), or the metric:
        |w * (q - K)|.

        Args:
            queries: Raw queries, in metres, seconds and radians, ``(n, 32)``.
            weights: Weights w, ``(n, 32)``; 1 if None.
            metric: Weight the metric instead of the query.

        Returns:
            Indices into :attr:`windows`, ``(n,)``.

        Raises:
            ValueError: If a shape is wrong or a number is not finite.
        """
        queries = _checked(queries, "queries", None)
        query = (np.clip(queries, self._low, self._high) - self.mean) * self.scale
        if weights is None:
            return self._nearest.query(query)
        weights = _checked(weights, "weights", len(query))
        return self._nearest.query(query, weights) if metric else self._nearest.query(weights * query)

    @classmethod
    def from_clips(cls, clips: Iterable[MotionClip], stride: int = 1) -> "MotionDatabase":
        """Makes a database of motion clips.

        Args:
            clips: The clips, of any frame rate.
            stride: Frames (1/30 s) between the starts of two clips of 0.5 s.

        Raises:
            ValueError: If there is no clip, one is shorter than 0.5 s, or the stride is not positive.
        """
        if stride < 1:
            raise ValueError(f"stride must be 1 or more frames, got {stride}.")
        parts: list[dict[str, Any]] = []
        offset = 0
        for clip in clips:
            part = _describe(clip.resampled(), stride)
            part["windows"] += offset
            offset += len(part["qpos"])
            parts.append(part)
        if not parts:
            raise ValueError("A motion database needs at least one clip; this one is empty.")
        joined = {
            name: np.concatenate([part[name] for part in parts]) for name in ("qpos", "states", "windows", "keys")
        }
        lengths = np.array([len(part["qpos"]) for part in parts])
        return cls(names=[part["name"] for part in parts], lengths=lengths, **joined)

    @classmethod
    def from_folder(cls, folder: str | Path, stride: int = 1) -> "MotionDatabase":
        """Makes a database of all motion files in a folder: BVH, AMC, AMASS, DeepMimic, or clips of this project.

        Args:
            folder: The folder; it is not searched deeper.
            stride: See :meth:`from_clips`.

        Raises:
            NotADirectoryError: If there is no such folder.
            ValueError: If it holds no motion file, one is shorter than 0.5 s, or one cannot be read.
        """
        folder = Path(folder)
        if not folder.is_dir():
            raise NotADirectoryError(f"No folder of motion clips at '{folder}'.")
        files = sorted(path for path in folder.iterdir() if path.suffix.lower() in _MOTION_SUFFIXES)
        if not files:
            raise ValueError(f"'{folder}' holds no motion file; the kinds that can be read end in {_MOTION_SUFFIXES}.")
        return cls.from_clips((read_motion(path) for path in files), stride)

    def save(self, path: str | Path) -> Path:
        """Writes the database as ``.npz`` without pickle, whole or not at all.

        Returns:
            The path written.
        """
        path = Path(path)
        header = {
            "format_version": _FORMAT_VERSION,
            "kind": "motion_database",
            "names": self.names,
            "key_layout": {name: [place.start, place.stop] for name, place in KEY_LAYOUT.items()},
        }
        arrays = {"header": np.array(json.dumps(header)), **{name: getattr(self, name) for name in _ARRAYS}}
        write_whole(path, lambda temporary: np.savez_compressed(temporary, **arrays))
        return path

    @classmethod
    def load(cls, path: str | Path) -> "MotionDatabase":
        """Reads a database that :meth:`save` wrote.

        Raises:
            FileNotFoundError: If the file does not exist.
            ValueError: If it is not such a file, or one with other keys.
        """
        path = Path(path)
        if not path.is_file():
            raise FileNotFoundError(f"No motion database at '{path}'.")
        again = "Make it again with MotionDatabase.from_folder(...).save(...)."
        try:
            with np.load(path, allow_pickle=False) as archive:
                header = json.loads(str(archive["header"]))
                arrays = {name: archive[name] for name in _ARRAYS}
        except (KeyError, ValueError, OSError, EOFError, zipfile.BadZipFile) as error:
            raise ValueError(f"'{path}' is not a motion database of this project ({error}). {again}") from error
        layout = {name: [place.start, place.stop] for name, place in KEY_LAYOUT.items()}
        if header.get("format_version") != _FORMAT_VERSION or header.get("key_layout") != layout:
            raise ValueError(f"'{path}' has keys of another version of this package. {again}")
        return cls(names=header["names"], **arrays)


def _describe(clip: MotionClip, stride: int) -> dict[str, Any]:
    """Poses, states, starts and keys of one clip at 30 frames per second."""
    starts = len(clip) - 1 if clip.loop else len(clip) - CLIP_FRAMES
    if starts < 1:
        raise ValueError(
            f"Clip '{clip.name}' has {len(clip)} frames ({clip.duration:.2f} s); retrieval needs at least "
            f"{CLIP_FRAMES + 1} (0.5 s). Leave it out, or mark it as looping if its last pose leads into the first."
        )
    # after each start of a loop there shall be 0.5 s to step along, and a whole window for the motion encoder after it
    clip = clip.repeated((len(clip) + CLIP_FRAMES + WINDOW_FRAMES) / FRAME_RATE)
    bodies = kinematics(clip.qpos).positions[:, [0, *END_EFFECTOR_INDEX]]
    states = state_key(bodies, clip.qpos[:, 3:7], np.gradient(bodies, 1 / FRAME_RATE, axis=0))
    windows = np.arange(0, starts, stride)
    frames = windows[:, None] + np.arange(CLIP_FRAMES + 1)
    course = course_key(clip.qpos[frames, :2], heading(clip.qpos[frames, 3:7]))
    keys = np.concatenate([states[windows], course], 1)
    return {"name": clip.name, "qpos": clip.qpos, "states": states, "windows": windows, "keys": keys}


def _checked(numbers: np.ndarray, what: str, count: int | None) -> np.ndarray:
    numbers = np.asarray(numbers, float)
    expected = (len(numbers) if numbers.ndim else 0) if count is None else count
    if numbers.shape != (expected, KEY_SIZE):
        raise ValueError(f"{what} must have shape ({count or 'n'}, {KEY_SIZE}), got {numbers.shape}.")
    if not np.isfinite(numbers).all():
        raise ValueError(f"The {what} of a search hold NaN or infinity; check the goal and the state of the character.")
    return numbers


def find_database(source: "MotionDatabase | str | Path") -> MotionDatabase:
    """The database that a short description stands for.

    Args:
        source: A database; or the path of a saved one (.npz) or of a folder of motion files; or what to take from the
            motion library, see :func:`select_clips`: a category such as "move_around", a pattern such as "walk*", or both.

    Raises:
        ValueError: If it is none of these, or the files cannot be used; the message lists the categories.
    """
    if isinstance(source, MotionDatabase):
        return source
    path = Path(source)
    if path.is_dir():
        return MotionDatabase.from_folder(path)
    if path.is_file():
        return MotionDatabase.load(path)
    if path.suffix == ".npz" or len(path.parts) > 1:
        raise ValueError(f"No motion database and no folder of motion clips at '{source}'.")
    return _library_database(str(source))


def select_clips(library: MotionLibrary, selection: str) -> list[MotionClip]:
    """The clips of a library that are in a category, or whose names match a pattern; or both, joined by "&".

    Args:
        library: The library.
        selection: Such as "move_around", "walk*" or "move_around&usual".

    Raises:
        ValueError: If there is none; the message lists the categories.
    """
    categories = {category for clip in library.clips for category in clip.categories}
    clips = library.clips
    for part in map(str.strip, selection.split("&")):
        if part in categories:
            clips = [clip for clip in clips if part in clip.categories]
        else:
            clips = [clip for clip in clips if fnmatch.fnmatchcase(clip.name, part)]
    if not clips:
        raise ValueError(
            f"'{selection}' is no motion database: neither a path that exists, nor a category of the motion library "
            f"({', '.join(sorted(categories))}), nor a pattern that matches a clip in `anyskill motions list`."
        )
    return clips


@cache
def _library_database(selection: str) -> MotionDatabase:
    """Part of the motion library; kept in the user's cache, since making the library takes seconds."""
    slug = re.sub(r"[^\w]+", "_", selection)
    file = imports_folder().parent / "databases" / f"{slug}-{_library_digest(selection)}.npz"
    if file.is_file():
        try:
            return MotionDatabase.load(file)
        except ValueError as error:
            _LOG.warning("Making the database again: %s", error)
    database = MotionDatabase.from_clips(select_clips(MotionLibrary.default(), selection))
    try:
        database.save(file)
    except OSError as error:
        _LOG.warning("The motion database cannot be kept for the next time: %s", error)
    return database


def _library_digest(selection: str) -> str:
    """Changes whenever the library may have changed: with this package, the mocap package and the imported clips."""
    digest = hashlib.sha256(selection.encode())
    for path in sorted(Path(__file__).parent.rglob("*")):
        if path.suffix in (".py", ".xml", ".yaml", ".npz"):
            digest.update(path.read_bytes())
    try:
        digest.update(importlib.metadata.version("pybullet").encode())
    except importlib.metadata.PackageNotFoundError:
        digest.update(b"no mocap")
    for path in sorted(imports_folder().glob("*.npz")):
        digest.update(f"{path} {path.stat().st_size} {path.stat().st_mtime_ns}".encode())
    return digest.hexdigest()[:16]


class MotionDatabases:
    """Several databases by name; each query says in which one to look.

    Frames are counted through all databases. Databases can be added at any time; frames keep their numbers.

    Args:
        databases: Name of each database and what :func:`find_database` takes.

    Attributes:
        names: Names of the databases.
        qpos: Poses of all frames, ``(F, 35)``.
        states: The part of a key that each frame's state determines, ``(F, 27)``.
        last: Last frame of the motion to which each frame belongs, ``(F,)``.

    Raises:
        ValueError: If there is none, or one cannot be made.
    """

    def __init__(self, databases: Mapping[str, MotionDatabase | str | Path]):
        if not databases:
            raise ValueError(f"Name at least one motion database, such as {{'locomotion': '{DEFAULT_SELECTION}'}}.")
        self.names: list[str] = []
        self._databases: list[MotionDatabase] = []
        self._offsets: list[int] = []
        self.qpos = np.empty((0, 35), np.float32)
        self.states = np.empty((0, STATE_SIZE), np.float32)
        self.last = np.empty(0, np.int64)
        self._motion_names = np.empty(0, str)
        self._motion_of_frame = np.empty(0, np.int64)
        for name, source in databases.items():
            self.add(name, source)

    def __getitem__(self, name: str) -> MotionDatabase:
        """The database of that name.

        Raises:
            ValueError: If there is none; the message lists the names.
        """
        return self._databases[self.index(name)]

    def index(self, name: str) -> int:
        """The number of a database.

        Raises:
            ValueError: If there is none of this name; the message lists the names.
        """
        if name not in self.names:
            raise ValueError(f"Unknown motion database {name!r}; those that exist are: {', '.join(self.names)}.")
        return self.names.index(name)

    def add(self, name: str, source: MotionDatabase | str | Path) -> None:
        """Adds a database.

        Raises:
            ValueError: If the name is taken or empty, or the database cannot be made.
        """
        if not name or name in self.names:
            raise ValueError(f"A motion database needs a name that is not taken, got {name!r}.")
        database = find_database(source)
        self.names.append(name)
        self._databases.append(database)
        offset = len(self.qpos)
        self._offsets.append(offset)
        self.qpos = np.concatenate([self.qpos, database.qpos])
        self.states = np.concatenate([self.states, database.states])
        self.last = np.concatenate([self.last, database.last + offset])
        self._motion_of_frame = np.concatenate(
            [self._motion_of_frame, database.motion_of_frame + len(self._motion_names)]
        )
        self._motion_names = np.concatenate([self._motion_names, np.array(database.names)])

    def motion_names(self, frames: np.ndarray) -> np.ndarray:
        """Name of the motion to which each of the frames ``(n,)`` belongs, ``(n,)`` strings."""
        return self._motion_names[self._motion_of_frame[frames]]

    def search(
        self, choice: np.ndarray, queries: np.ndarray, weights: np.ndarray | None = None, metric: bool = False
    ) -> np.ndarray:
        """The first frame of the nearest clip for each query.

        Args:
            choice: Number of the database to look in, ``(n,)``.
            queries: As :meth:`MotionDatabase.search` takes them, ``(n, 32)``.
            weights: Likewise, ``(n, 32)``.
            metric: Likewise.

        Returns:
            Frames, ``(n,)``.
        """
        frames = np.empty(len(queries), np.int64)
        for number in np.unique(choice):
            mine = np.flatnonzero(choice == number)
            database = self._databases[number]
            found = database.search(queries[mine], None if weights is None else weights[mine], metric)
            frames[mine] = database.windows[found] + self._offsets[number]
        return frames
