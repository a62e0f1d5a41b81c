"""Speed at run time.

``machine`` turns programs into LLVM kernels over batches of samples, cached, on several threads.  ``observe`` stacks
rows of regressors block by block into R-factors, so that a matrix of ten million rows is never kept.
"""

from echelon.shared.facade import door

__all__, __getattr__, __dir__ = door(__name__)
