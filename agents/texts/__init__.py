"""From captions of motions to instructions that a policy can learn: filter, score, rewrite (AnySkill, appendix A.1)."""
