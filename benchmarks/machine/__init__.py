"""What machine code is worth: rows of measurements beside the anchors, their targets and their tables."""
