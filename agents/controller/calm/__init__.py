"""CALM (Tessler et al. 2023) as AnySkill trains its low-level controller: imitation by a conditional discriminator."""
