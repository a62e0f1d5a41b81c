"""What is read, within limits: content of files, JSON, YAML and XML as plain data."""
