// From entries to rows: entry e of sample i stands at entries[e*count + i]; place p of its row at rows[i*width + p].
// entry_at[p] is the entry at place p, or -1 where the result is structurally zero.
//
// Blocks of 32 x 8 threads turn tiles of 32 x 32 numbers in shared memory, so that neighbouring threads read
// neighbouring samples and write neighbouring places.  Column 33 of the tile keeps threads off the same memory bank.

extern "C" __global__ void echelon_rows(
    const long long count,
    const long long width,
    const long long* __restrict__ entry_at,
    const real* __restrict__ entries,
    real* __restrict__ rows)
{
    __shared__ real tile[32][33];
    const long long first_sample = (long long)blockIdx.x*32;
    const long long first_place = (long long)blockIdx.y*32;
    const long long sample_read = first_sample + threadIdx.x;
    for (int k = threadIdx.y; k < 32; k += 8) {
        const long long place = first_place + k;
        if (place < width && sample_read < count) {
            const long long entry = entry_at[place];
            tile[k][threadIdx.x] = entry < 0 ? (real)0 : entries[entry*count + sample_read];
        }
    }
    __syncthreads();
    const long long place_written = first_place + threadIdx.x;
    for (int k = threadIdx.y; k < 32; k += 8) {
        const long long sample = first_sample + k;
        if (place_written < width && sample < count) {
            rows[sample*width + place_written] = tile[threadIdx.x][k];
        }
    }
}
