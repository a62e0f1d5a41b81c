// How fast this machine writes: the bound of whatever stores a large regressor.

#include <chrono>
#include <cstdint>
#include <cstring>
#include <thread>
#include <vector>

#if defined(__SSE2__)
#include <immintrin.h>
#endif

namespace {

// Past the caches where the processor can; the vector is as wide as the build's target allows.
void stream(double *to, std::int64_t count) {
#if defined(__AVX512F__)
  const __m512d value = _mm512_set1_pd(1.0);
  for (std::int64_t i = 0; i + 8 <= count; i += 8) _mm512_stream_pd(to + i, value);
  _mm_sfence();
#elif defined(__AVX__)
  const __m256d value = _mm256_set1_pd(1.0);
  for (std::int64_t i = 0; i + 4 <= count; i += 4) _mm256_stream_pd(to + i, value);
  _mm_sfence();
#elif defined(__SSE2__)
  const __m128d value = _mm_set1_pd(1.0);
  for (std::int64_t i = 0; i + 2 <= count; i += 2) _mm_stream_pd(to + i, value);
  _mm_sfence();
#else
  for (std::int64_t i = 0; i < count; ++i) to[i] = 1.0;
#endif
}

void plain(double *to, std::int64_t count) { std::memset(to, 1, 8 * count); }

}  // namespace

// Seconds to write `count` doubles at an address aligned to 64 bytes, each thread its part.
extern "C" double anchor_write(double *to, std::int64_t count, int threads, int past_caches) {
  const auto start = std::chrono::steady_clock::now();
  auto *const write = past_caches ? stream : plain;
  const std::int64_t lines = count / 8;
  std::vector<std::thread> pool;
  for (int k = 1; k < threads; ++k) {
    const std::int64_t from = lines * k / threads, end = lines * (k + 1) / threads;
    pool.emplace_back(write, to + 8 * from, 8 * (end - from));
  }
  write(to, 8 * (lines / threads));
  for (auto &thread : pool) thread.join();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}
