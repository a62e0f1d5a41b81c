// CUDA kernels of independent threads on the processor: one call after the other.
#include <cmath>
#include <functional>

#define __device__
#define __global__
#define __forceinline__ inline
#define __noinline__ __attribute__((noinline))

struct Index { unsigned x, y, z; };
static Index threadIdx, blockIdx, blockDim, gridDim;

static void launch(const unsigned blocks, const unsigned threads, const std::function<void()>& kernel)
{
    gridDim = Index{blocks, 1, 1};
    blockDim = Index{threads, 1, 1};
    for (unsigned k = 0; k < blocks*threads; k++) {
        blockIdx = Index{k/threads, 0, 0};
        threadIdx = Index{k%threads, 0, 0};
        kernel();
    }
}
