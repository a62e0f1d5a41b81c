// R-factors of tall matrices, one for each output, by Householder reflectors.
//
// Column c of all outputs' matrices together stands at source[c*stride]; output o has sizes[o] of them from
// first_column[o].  Each block of threads factors `chunk` rows of one output in place and writes R, with zeros below its
// diagonal, to rows r*n to r*n + n - 1 of the target, where r is the number of the chunk and n = sizes[o].  The target
// is the source of the next level, until one chunk is left.  Sums have a fixed order, so that results are the same
// every time.
//
// Everything not finite in a matrix makes its R not finite.

static __device__ __forceinline__ double larger(const double a, const double b)
{
    return (b > a || b != b) ? b : a;  // NaN if either is
}

// The largest value or the sum of all threads' values, in every thread.
static __device__ double combined(double value, const bool sum, double* partial)
{
    for (int distance = 16; distance > 0; distance /= 2) {
        const double other = __shfl_xor_sync(0xffffffffu, value, distance);
        value = sum ? value + other : larger(value, other);
    }
    if (threadIdx.x%32 == 0) {
        partial[threadIdx.x/32] = value;
    }
    __syncthreads();
    double total = partial[0];
    for (int warp = 1; warp < (int)(blockDim.x/32); warp++) {
        total = sum ? total + partial[warp] : larger(total, partial[warp]);
    }
    __syncthreads();  // before `partial` is used again
    return total;
}

// Makes column v zero below row k: afterwards v[k] is the entry of R, and the reflector I - tau (1, v) (1, v)' stands
// below it.  Returns tau, 0 if there was nothing to do.
static __device__ double reflector(double* v, const long long k, const long long rows, double* partial)
{
    double largest = 0.0;
    for (long long r = k + 1 + threadIdx.x; r < rows; r += blockDim.x) {
        largest = larger(largest, fabs(v[r]));
    }
    const double alpha = v[k];
    const double scale = combined(largest, false, partial);
    if (scale == 0.0) {
        return 0.0;
    }
    double squares = 0.0;
    for (long long r = k + 1 + threadIdx.x; r < rows; r += blockDim.x) {
        const double x = v[r]/scale;
        squares += x*x;
    }
    const double norm = hypot(alpha, scale*sqrt(combined(squares, true, partial)));
    const double beta = alpha > 0.0 ? -norm : norm;
    for (long long r = k + 1 + threadIdx.x; r < rows; r += blockDim.x) {
        v[r] = v[r]/(alpha - beta);
    }
    if (threadIdx.x == 0) {
        v[k] = beta;
    }
    return (beta - alpha)/beta;
}

// Applies a reflector to column a, by one warp.
static __device__ void reflect(
    const double* v, const double tau, double* a, const long long k, const long long rows)
{
    const int lane = threadIdx.x%32;
    double dot = lane == 0 ? a[k] : 0.0;
    for (long long r = k + 1 + lane; r < rows; r += 32) {
        dot += v[r]*a[r];
    }
    for (int distance = 16; distance > 0; distance /= 2) {
        dot += __shfl_xor_sync(0xffffffffu, dot, distance);
    }
    const double factor = tau*dot;
    if (lane == 0) {
        a[k] -= factor;
    }
    for (long long r = k + 1 + lane; r < rows; r += 32) {
        a[r] -= factor*v[r];
    }
}

extern "C" __global__ void echelon_triangles(
    const long long level,
    const long long count,
    const long long chunk,
    const long long* sizes,
    const long long* first_column,
    const long long stride,
    double* source,
    const long long target_stride,
    double* target)
{
    __shared__ double partial[32];
    const int warp = threadIdx.x/32;
    const int warps = blockDim.x/32;
    const long long n = sizes[blockIdx.y];
    long long all = count;
    for (long long k = 0; k < level; k++) {
        all = (all + chunk - 1)/chunk*n;
    }
    const long long start = (long long)blockIdx.x*chunk;
    if (start >= all) {
        return;
    }
    const long long rows = all - start < chunk ? all - start : chunk;
    double* const A = source + first_column[blockIdx.y]*stride + start;
    for (long long k = 0; k < n && k < rows; k++) {
        const double tau = reflector(A + k*stride, k, rows, partial);
        __syncthreads();
        if (tau != 0.0) {
            for (long long j = k + 1 + warp; j < n; j += warps) {
                reflect(A + k*stride, tau, A + j*stride, k, rows);
            }
        }
        __syncthreads();
    }
    double* const R = target + first_column[blockIdx.y]*target_stride + (long long)blockIdx.x*n;
    for (long long j = warp; j < n; j += warps) {
        for (long long i = threadIdx.x%32; i < n; i += 32) {
            R[j*target_stride + i] = i <= j && i < rows ? A[j*stride + i] : 0.0;
        }
    }
}
