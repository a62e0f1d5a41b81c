"""Reports and previews: one self-contained HTML page about an identification or a trajectory."""

from echelon.shared.facade import door

__all__, __getattr__, __dir__ = door(__name__)
