"""The judge: hypotheses on a robot and its logs, all scored by how well held-out stretches of time are predicted."""
