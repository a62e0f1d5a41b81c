"""Machine code at run time: programs as LLVM kernels over batches of samples, cached, on several threads."""
