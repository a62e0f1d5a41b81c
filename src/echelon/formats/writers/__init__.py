"""Writers of descriptions, and of identified robots in the formats of their files."""
