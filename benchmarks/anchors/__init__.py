"""What machine code is compared with: C++ built on first use, and other tools run on the same states."""
