"""Training of the bundled encoder: graded facts about poses, captions, states, towers."""
