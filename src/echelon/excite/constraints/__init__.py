"""What a robot can do and where it may go."""
