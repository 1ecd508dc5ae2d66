"""Text skills: train a policy for one sentence, check it from body positions, export it and watch it."""
