"""Names that other rooms may use, and where each is defined."""
