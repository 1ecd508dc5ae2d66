"""Measures of motion: foot skate and jerk of body paths; Frechet distance, diversity and multimodality of features; CLIP_S.

All are pure functions of arrays, batched over leading dimensions where a motion is measured. Features may come from any
encoder; distances of different encoders cannot be compared. `motion_data.motion_features` has features without an encoder.
"""

import numpy as np
from scipy.spatial.distance import cdist

from motion_data.inverse_kinematics import SIDES, floor_reach
from motion_data.skeleton import FRAME_RATE, body_index

CONTACT_HEIGHT = 0.025
"""Height (metres) above which a point of the sole no longer counts as on the floor."""


def sole_corners(positions: np.ndarray, quaternions: np.ndarray) -> np.ndarray:
    """Where the corners of both soles are.

    Args:
        positions: Origins of the bodies, ``(..., T, 15, 3)`` metres.
        quaternions: Orientations of the bodies, w first, ``(..., T, 15, 4)``.

    Returns:
        Four corners of the right foot and four of the left, ``(..., T, 8, 3)`` metres.
    """
    corners = []
    for side in SIDES:
        foot = body_index(f"{side}_foot")
        place, quaternion = positions[..., None, foot, :], quaternions[..., None, foot, :]
        corners.append(place + _turn(quaternion, floor_reach(side)))
    return np.concatenate(corners, -2)


def _turn(quaternions: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Vectors ``(..., 3)`` turned by unit quaternions ``(..., 4)``, w first."""
    w, axis = quaternions[..., :1], quaternions[..., 1:]
    twice = 2 * np.cross(axis, vectors)
    return vectors + w * twice + np.cross(axis, twice)


def foot_skate(points: np.ndarray, fps: float = FRAME_RATE, contact_height: float = CONTACT_HEIGHT) -> np.ndarray:
    """How fast points slide over the floor while they touch it.

    Zhang, Starke, Komura and Saito 2018 ("Mode-adaptive neural networks for quadruped motion control") weigh
    the horizontal speed v of a foot at the height h by contact: v (2 - 2^(h / H)) with h / H held within [0, 1], so 1 on
    the floor and 0 from the height H on. Here the sum over frames and points is divided by the sum of the weights, not
    by the number of frames: the measure is a speed in contact, which does not depend on how long the feet are in the air.

    Args:
        points: Points that may touch the floor (z = 0), such as :func:`sole_corners`, ``(..., T, P, 3)`` metres.
        fps: Frames per second.
        contact_height: H in metres.

    Returns:
        Metres per second, ``(...)``; NaN where no point ever touches the floor.
    """
    step = np.diff(points[..., :2], axis=-3)
    speed = np.linalg.norm(step, axis=-1) * fps
    # A step counts as in contact as far as both its ends are.
    height = np.maximum(points[..., 1:, :, 2], points[..., :-1, :, 2])
    weight = 2 - 2 ** np.clip(height / contact_height, 0, 1)
    total = weight.sum((-2, -1))
    return np.where(total > 0, (weight * speed).sum((-2, -1)) / np.where(total > 0, total, 1), np.nan)


def jerk(positions: np.ndarray, fps: float = FRAME_RATE) -> np.ndarray:
    """Mean size of the third derivative of paths by finite differences; smooth motion has little (Flash and Hogan 1985).

    Args:
        positions: Paths, such as those of the bodies, ``(..., T, B, 3)`` metres, T at least 4.
        fps: Frames per second.

    Returns:
        Mean over frames and paths, metres per second cubed, ``(...)``.

    Raises:
        ValueError: If there are fewer than 4 frames.
    """
    if positions.shape[-3] < 4:
        raise ValueError(f"Jerk needs at least 4 frames, got {positions.shape[-3]}.")
    third = np.diff(positions, n=3, axis=-3) * fps**3
    return np.linalg.norm(third, axis=-1).mean((-2, -1))


def clip_similarity(image_features: np.ndarray, text_feature: np.ndarray) -> np.ndarray:
    """CLIP_S, by which AnySkill (Cui et al., CVPR 2024, section 4.2) judges motions: 100 times the cosine of image and text.

    The paper defines it as "CLIP similarity between rendered images and text"; the factor 100 follows from the size of its
    numbers (18 to 25), and what it makes of several frames is nowhere stated: here it is their mean. That of different
    encoders cannot be compared, and one by the encoder of the reward measures what was trained for.

    Args:
        image_features: Features of the frames of a motion, ``(..., T, d)``; need not have unit length.
        text_feature: Feature of the text, ``(d,)``.

    Returns:
        From -100 to 100, ``(...)``.
    """
    lengths = np.linalg.norm(image_features, axis=-1) * np.linalg.norm(text_feature)
    return 100 * (image_features @ text_feature / np.maximum(lengths, 1e-12)).mean(-1)


def frechet_distance(first: np.ndarray, second: np.ndarray) -> float:
    """Squared Frechet (Wasserstein-2) distance of the normal distributions fitted to two sets of features.

    Heusel et al. 2017 ("GANs trained by a two time-scale update rule ..."): |m1 - m2|^2 + tr(C1 + C2 - 2 (C1 C2)^(1/2)),
    in squared units of the features. It is biased upwards for small sets: compare sets of equal size, and with
    :func:`frechet_floor`.

    Args:
        first: Features, ``(n, d)``, n at least 2.
        second: Features, ``(m, d)``, m at least 2.

    Raises:
        ValueError: If a shape is wrong or a number is not finite.
    """
    first, second = _features(first), _features(second)
    if first.shape[1] != second.shape[1]:
        raise ValueError(f"The features have different sizes, {first.shape[1]} and {second.shape[1]}.")
    covariances = [np.atleast_2d(np.cov(features, rowvar=False)) for features in (first, second)]
    # tr (C1 C2)^(1/2) is the sum of the roots of the eigenvalues of R C2 R with R = C1^(1/2), which is symmetric.
    values, vectors = np.linalg.eigh(covariances[0])
    root = (vectors * np.sqrt(np.maximum(values, 0))) @ vectors.T
    product = np.linalg.eigvalsh(root @ covariances[1] @ root)
    overlap = np.sqrt(np.maximum(product, 0)).sum()
    means = first.mean(0) - second.mean(0)
    distance = means @ means + np.trace(covariances[0]) + np.trace(covariances[1]) - 2 * overlap
    return float(max(distance, 0.0))


def frechet_floor(features: np.ndarray, rng: np.random.Generator, repeats: int = 10) -> float:
    """Mean Frechet distance between two random halves of one set: what no generator of that many samples can beat.

    Args:
        features: Features of real motion, ``(n, d)``, n at least 4.
        rng: Source of the halves.
        repeats: Over how many divisions the mean is taken.

    Raises:
        ValueError: If there are fewer than 4 features, or repeats is not positive.
    """
    features = _features(features)
    if len(features) < 4 or repeats < 1:
        raise ValueError(f"A floor needs at least 4 features and 1 repeat, got {len(features)} and {repeats}.")
    half = len(features) // 2
    distances = []
    for _ in range(repeats):
        order = rng.permutation(len(features))
        distances.append(frechet_distance(features[order[:half]], features[order[half : 2 * half]]))
    return float(np.mean(distances))


def nearest_distance(features: np.ndarray, reference: np.ndarray) -> float:
    """Mean distance from each feature to the nearest one of a reference set.

    Unlike the Frechet distance it does not ask for the variety of the reference: a motion that does one thing, and does it
    as the reference shows it, is near. (Precision of Kynkaanniemi et al. 2019, "Improved precision and recall metric", as a
    distance instead of a share.)

    Args:
        features: Features, ``(n, d)``, n at least 2.
        reference: Features of real motion, ``(m, d)``, m at least 2.

    Returns:
        Distance in units of the features.

    Raises:
        ValueError: If a shape is wrong or a number is not finite.
    """
    features, reference = _features(features), _features(reference)
    if features.shape[1] != reference.shape[1]:
        raise ValueError(f"The features have different sizes, {features.shape[1]} and {reference.shape[1]}.")
    return float(cdist(features, reference).min(1).mean())


def diversity(features: np.ndarray, rng: np.random.Generator, pairs: int = 200) -> float:
    """Mean distance between motions drawn at random, whatever they show.

    Guo et al. 2020 ("Action2Motion"): two sets of S motions are drawn, and the distances of the features of
    their i-th members averaged; S = 200. A motion is never paired with itself.

    Args:
        features: Features, ``(n, d)``, n at least 2.
        rng: Source of the pairs.
        pairs: S.

    Returns:
        Distance in units of the features.

    Raises:
        ValueError: If there are fewer than 2 features or no pairs.
    """
    return float(_pair_distances(_features(features)[None], rng, pairs).mean())


def multimodality(features: np.ndarray, rng: np.random.Generator, pairs: int = 20) -> float:
    """Mean distance between motions of the same action (or text), over all actions.

    Guo et al. 2020 ("Action2Motion"): as :func:`diversity` within each action, S = 20, averaged.

    Args:
        features: Features of n motions of each of C actions, ``(C, n, d)``, n at least 2.
        rng: Source of the pairs.
        pairs: S.

    Returns:
        Distance in units of the features.

    Raises:
        ValueError: If the shape is wrong, or there are no pairs.
    """
    features = np.asarray(features, float)
    if features.ndim != 3 or features.shape[1] < 2 or not features.size:
        raise ValueError(f"Features must be (actions, at least 2 motions, size), got {features.shape}.")
    return float(_pair_distances(features, rng, pairs).mean())


def _pair_distances(features: np.ndarray, rng: np.random.Generator, pairs: int) -> np.ndarray:
    """Distances of random pairs within each set ``(C, n, d)``, ``(C, pairs)``."""
    if pairs < 1:
        raise ValueError(f"pairs must be at least 1, got {pairs}.")
    sets, count = features.shape[:2]
    one = rng.integers(count, size=(sets, pairs))
    other = (one + rng.integers(1, count, size=one.shape)) % count
    index = np.arange(sets)[:, None]
    return np.linalg.norm(features[index, one] - features[index, other], axis=-1)


def _features(features: np.ndarray) -> np.ndarray:
    features = np.asarray(features, float)
    if features.ndim != 2 or len(features) < 2 or not features.shape[1]:
        raise ValueError(f"Features must be (at least 2, size), got {features.shape}.")
    if not np.isfinite(features).all():
        raise ValueError("Features have NaN or infinite numbers.")
    return features
