"""Source text: recorded functions printed in other languages, from one printer and templates per language."""
