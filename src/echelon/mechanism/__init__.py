"""Bodies, joints, couplings and gravity: frozen descriptions of machines."""
