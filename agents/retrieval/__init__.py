"""Retrieval locomotion: training, evaluation and play of retrievers over the frozen controller."""
