"""What the jobs that learn with PPO share: options, the run from options to report, its folder and its export."""
