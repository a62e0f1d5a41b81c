// CUDA kernels on the processor: every thread is a fiber that runs until it has to wait for others.  Warps run one after
// the other as far as they get, in either order, so that a missing barrier gives wrong results.
#include <cmath>
#include <csetjmp>
#include <functional>
#include <ucontext.h>
#include <vector>

#define __device__
#define __global__
#define __shared__ static
#define __forceinline__ inline
#define __noinline__ __attribute__((noinline))

struct Index { unsigned x, y, z; };
static Index threadIdx, blockIdx, blockDim, gridDim;

namespace emulation {

struct Barrier { unsigned size, waiting; unsigned long generation; };
struct Fiber { ucontext_t context; jmp_buf place; Index index; bool started, done; };

static const size_t STACK = 1 << 18;
static std::vector<char> stacks;
static std::vector<Fiber> fibers;
static std::vector<Barrier> warps;
static Barrier block;
static ucontext_t ending;
static jmp_buf scheduler;
static size_t current;
static unsigned long progress;
static const std::function<void()>* work;
static double slots[1024];

static void wait(Barrier& barrier)
{
    progress++;
    const unsigned long mine = barrier.generation;
    if (++barrier.waiting == barrier.size) {
        barrier.waiting = 0;
        barrier.generation++;
    }
    while (barrier.generation == mine) {
        // contexts only start fibers: changing them costs system calls
        if (!_setjmp(fibers[current].place)) {
            _longjmp(scheduler, 1);
        }
    }
}

static void enter()
{
    (*work)();
    fibers[current].done = true;
    progress++;
    _longjmp(scheduler, 1);
}

static void resume(Fiber& fiber)
{
    if (_setjmp(scheduler)) {
        return;
    }
    if (fiber.started) {
        _longjmp(fiber.place, 1);
    }
    fiber.started = true;
    setcontext(&fiber.context);
}

// Runs a warp as far as it gets without the others, as a device may; returns the number of threads that end.
static unsigned run_warp(const unsigned warp, const bool backwards)
{
    unsigned ended = 0;
    for (unsigned long before = progress - 1; progress != before;) {
        before = progress;
        for (unsigned k = 0; k < warps[warp].size; k++) {
            current = 32*warp + (backwards ? warps[warp].size - 1 - k : k);
            if (!fibers[current].done) {
                threadIdx = fibers[current].index;
                resume(fibers[current]);
                ended += fibers[current].done;
            }
        }
    }
    return ended;
}

// false if threads wait for others that never come
static bool run_block(const bool backwards)
{
    const unsigned count = blockDim.x*blockDim.y*blockDim.z;
    stacks.resize(STACK*count);
    fibers.resize(count);
    warps.assign((count + 31)/32, Barrier{32, 0, 0});
    if (count%32) {
        warps.back().size = count%32;
    }
    block = Barrier{count, 0, 0};
    for (unsigned k = 0; k < count; k++) {
        Fiber& fiber = fibers[k];
        fiber.index = Index{k%blockDim.x, k/blockDim.x%blockDim.y, k/blockDim.x/blockDim.y};
        fiber.started = fiber.done = false;
        getcontext(&fiber.context);
        fiber.context.uc_stack.ss_sp = &stacks[STACK*k];
        fiber.context.uc_stack.ss_size = STACK;
        fiber.context.uc_link = &ending;
        makecontext(&fiber.context, enter, 0);
    }
    for (unsigned left = count; left;) {
        const unsigned long before = progress;
        for (unsigned w = 0; w < warps.size(); w++) {
            left -= run_warp(backwards ? (unsigned)warps.size() - 1 - w : w, backwards);
        }
        if (progress == before) {
            return false;
        }
    }
    return true;
}

static int launch(const unsigned* grid, const unsigned* threads, const int backwards, const std::function<void()>& kernel)
{
    gridDim = Index{grid[0], grid[1], grid[2]};
    blockDim = Index{threads[0], threads[1], threads[2]};
    work = &kernel;
    const unsigned long blocks = (unsigned long)grid[0]*grid[1]*grid[2];
    for (unsigned long k = 0; k < blocks; k++) {
        const unsigned long b = backwards ? blocks - 1 - k : k;
        blockIdx = Index{(unsigned)(b%grid[0]), (unsigned)(b/grid[0]%grid[1]), (unsigned)(b/grid[0]/grid[1])};
        if (!run_block(backwards)) {
            return 1;
        }
    }
    return 0;
}

}  // namespace emulation

[[maybe_unused]] static void __syncthreads()
{
    emulation::wait(emulation::block);
}

[[maybe_unused]] static double __shfl_xor_sync(unsigned, const double value, const int distance)
{
    const unsigned thread = threadIdx.x + blockDim.x*(threadIdx.y + blockDim.y*threadIdx.z);
    emulation::slots[thread] = value;
    emulation::wait(emulation::warps[thread/32]);
    const double other = emulation::slots[thread/32*32 + (thread%32 ^ (unsigned)distance)];
    emulation::wait(emulation::warps[thread/32]);
    return other;
}
