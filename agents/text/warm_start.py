"""Puts what the search found into a policy: a held latent as the bias of its mean, a played clip by imitation."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray
from stable_baselines3 import PPO

from agents.text.search import TRIAL_DECISIONS, Candidate, Earnings, search, summary

FloatArray = NDArray[np.float32]

IMITATION_EPISODE = 60
"""Decisions of an episode that is imitated: 10 s."""
IMITATION_STEPS = 400
IMITATION_BATCH = 512


def hold(model: PPO, latent: FloatArray) -> None:
    """Makes a policy's mean a constant latent `(64,)`, up to the small output of its untrained layers."""
    with torch.no_grad():
        dict(model.policy.named_parameters())["action_net.bias"].copy_(torch.as_tensor(latent))


def record(
    env: VectorEnv, candidate: Candidate, noise: float, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Plays a candidate on every humanoid, each with noise of its own on the latents.

    The noise makes states around the motion known, from which the imitating policy then finds back.

    Args:
        env: A latent environment of n humanoids.
        candidate: What to play.
        noise: Standard deviation of the noise in each number of the latent.
        rng: Draws noise and start states.

    Returns:
        Observations `(k, 223)` and the latents without noise `(k, 64)` that were meant there, those of terminated
        humanoids left out.
    """
    observation, _ = env.reset(seed=int(rng.integers(2**31)))
    alive = np.ones(env.num_envs, bool)
    observations, latents = [], []
    for latent in candidate.unrolled(IMITATION_EPISODE):
        observations.append(observation[alive])
        latents.append(np.tile(latent, (int(alive.sum()), 1)))
        actions = latent + rng.normal(0.0, noise, (env.num_envs, len(latent))).astype(np.float32)
        observation, _, terminated, _, _ = env.step(np.clip(actions, -1.0, 1.0))
        alive &= ~terminated
        if not alive.any():
            break
    return np.concatenate(observations), np.concatenate(latents)


def imitate(model: PPO, observations: FloatArray, latents: FloatArray, rng: np.random.Generator) -> float:
    """Fits the policy's mean action to latents by least squares.

    Args:
        model: The model; an optimiser of its own is used, so PPO's is untouched.
        observations: `(k, 223)`.
        latents: `(k, 64)`.
        rng: Draws minibatches.

    Returns:
        Mean squared error, summed over the 64 numbers, in the last tenth of the steps.
    """
    policy = model.policy
    mean = torch.nn.Sequential(policy.mlp_extractor.policy_net, policy.action_net)
    optimiser = torch.optim.Adam(mean.parameters(), lr=1e-3)
    inputs, wanted = torch.as_tensor(observations), torch.as_tensor(latents)
    errors = []
    for _ in range(IMITATION_STEPS):
        rows = torch.as_tensor(rng.integers(len(inputs), size=IMITATION_BATCH))
        error = (mean(inputs[rows]) - wanted[rows]).square().sum(-1).mean()
        optimiser.zero_grad()
        error.backward()
        optimiser.step()
        errors.append(float(error.detach()))
    return float(np.mean(errors[-IMITATION_STEPS // 10 :]))


def policy_reward(env: VectorEnv, model: PPO, alive_bonus: float, rng: np.random.Generator) -> float:
    """Mean reward per decision of the deterministic policy, counted as the search counts it."""
    observation, _ = env.reset(seed=int(rng.integers(2**31)))
    earnings = Earnings(env.num_envs, alive_bonus)
    for _ in range(TRIAL_DECISIONS):
        action, _ = model.predict(observation, deterministic=True)
        observation, reward, terminated, _, _ = env.step(action)
        earnings.add(reward, terminated)
    return float(earnings.means().mean())


def warm_start(
    model: PPO,
    env: VectorEnv,
    latents: FloatArray,
    names: NDArray[np.str_],
    alive_bonus: float,
    seed: int,
    seconds: float = np.inf,
) -> dict[str, Any]:
    """Lets a policy start from what the search finds.

    A played clip that earns more than the best held latent is imitated; if the imitation earns less after all, the
    policy holds the latent.

    Args:
        model: An untrained model.
        env: A latent environment with the reward of training.
        latents: The library's latents, `(k, 64)`.
        names: The clip of each, `(k,)`.
        alive_bonus: Bonus of training for a decision without a fall.
        seed: Seed of everything that is drawn.
        seconds: No new round of the search begins after this time.

    Returns:
        What the report says about it.
    """
    rng = np.random.default_rng(seed)
    result = search(env, latents, names, alive_bonus, rng, seconds=seconds)
    report = summary(result)
    start, reward = "held", result.held.reward
    untrained = {name: value.clone() for name, value in model.policy.state_dict().items()}
    if result.played is not None and result.played.reward > result.held.reward:
        noise = float(model.policy.log_std.detach().exp().mean())
        observations, wanted = record(env, result.played, noise, rng)
        error = imitate(model, observations, wanted, rng)
        imitated = policy_reward(env, model, alive_bonus, rng)
        report["imitation"] = {"reward": imitated, "squared_error": error}
        if imitated > result.held.reward:
            start, reward = "played", imitated
        else:
            model.policy.load_state_dict(untrained)
    if start == "held":
        hold(model, result.held.latents[0])
    with torch.no_grad():
        # The value of earning this for ever (as agents.text.shaping scales it), which by gradient descent it would take
        # the first updates to find.
        dict(model.policy.named_parameters())["value_net.bias"].fill_(reward + alive_bonus)
    return report | {"start": start, "reward": reward}
