"""Training of the low-level controller: motion tracking, distillation into a latent space, evaluation, export."""
