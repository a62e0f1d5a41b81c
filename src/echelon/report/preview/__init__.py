"""A page about an exciting trajectory, to be looked at before anything moves."""
