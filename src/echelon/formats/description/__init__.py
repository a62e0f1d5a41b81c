"""The reader of descriptions, the YAML and JSON format of Echelon."""
