// Numbers the kernels compute with: eight lanes of float at a time on the CPU, one float a thread on CUDA.
// `Real`, `Mask` and the functions below are all that the per-Gaussian code of the other headers uses, so that one
// text serves both devices.
#pragma once

#if defined(__CUDACC__)
#define RASTER_FN __device__ __forceinline__
#define RASTER_FN_MEMBER __device__ __forceinline__
#else
#define RASTER_FN static inline __attribute__((always_inline))
#define RASTER_FN_MEMBER inline __attribute__((always_inline))
#endif

namespace raster {

enum { TILE_WIDTH = 8, TILE_HEIGHT = 16 };  // one row of a tile is one vector on the CPU
enum { SPLAT_FLOATS = 16, MOMENTS = 12 };   // floats of a projected Gaussian; of an intersection's gradient

#define RASTER_ALPHA_MIN (1.0f / 255.0f)  // smaller opacities are not blended
#define RASTER_ALPHA_MAX 0.999f           // keeps 1 / (1 - alpha) bounded
#define RASTER_TRANSMITTANCE_MIN 1e-4f    // blending stops once it is below
#define RASTER_LOG2_E 1.44269504089f
#define RASTER_LN_2 0.69314718056f

RASTER_FN int imin(int a, int b) { return a < b ? a : b; }
RASTER_FN int imax(int a, int b) { return a > b ? a : b; }

#if defined(__CUDACC__)

enum { LANES = 1 };
typedef float Real;
typedef bool Mask;

RASTER_FN Real splat(float x) { return x; }
RASTER_FN Real select(Mask m, Real a, Real b) { return m ? a : b; }
RASTER_FN Real square_root(Real x) { return sqrtf(x); }
RASTER_FN Real exp2_of(Real x) { return exp2f(x); }
RASTER_FN Real log2_of(Real x) { return log2f(x); }
RASTER_FN Real floor_of(Real x) { return floorf(x); }
RASTER_FN Real ceiling(Real x) { return ceilf(x); }
RASTER_FN Real lane_indices() { return 0.0f; }
RASTER_FN Mask is_finite(Real x) { return x - x == 0.0f; }
RASTER_FN float lane(Real x, int) { return x; }
RASTER_FN bool lane_is_set(Mask m, int) { return m; }
RASTER_FN Real gather(const float* p, const int* index, int stride) { return p[(size_t)index[0] * stride]; }
RASTER_FN Real load(const float* p) { return *p; }
RASTER_FN void store(float* p, Real r) { *p = r; }
RASTER_FN void set_lane(Real& r, int, float x) { r = x; }

#else

enum { LANES = 8 };
typedef float Real __attribute__((vector_size(32)));
typedef int Mask __attribute__((vector_size(32)));  // 0 or -1 a lane

RASTER_FN Real splat(float x) { return Real{x, x, x, x, x, x, x, x}; }
RASTER_FN Real select(Mask m, Real a, Real b) { return m ? a : b; }
RASTER_FN Real square_root(Real x) { return __builtin_elementwise_sqrt(x); }
RASTER_FN Real floor_of(Real x) { return __builtin_elementwise_floor(x); }
RASTER_FN Real ceiling(Real x) { return __builtin_elementwise_ceil(x); }
RASTER_FN Real lane_indices() { return Real{0.0f, 1.0f, 2.0f, 3.0f, 4.0f, 5.0f, 6.0f, 7.0f}; }
RASTER_FN Mask is_finite(Real x) { return x - x == splat(0.0f); }
RASTER_FN float lane(Real x, int i) { return x[i]; }
RASTER_FN bool lane_is_set(Mask m, int i) { return m[i] != 0; }
RASTER_FN void set_lane(Real& r, int i, float x) { r[i] = x; }

#define EXP2_ROUNDER 12582912.0f  // 1.5 * 2^23: the sum's low mantissa bits hold the integer
// Minimax in relative error on [-1/2, 1/2], highest power first.
#define EXP2_COEFFICIENTS {0.00132764719f, 0.00967554077f, 0.0555071337f, 0.240221197f, 0.693146967f, 1.00000007f}

// 2^x for -126 <= x <= 126, relative error 1.5e-7: nearest integer by the rounding of a large sum, minimax polynomial
// for the rest. Other arguments give garbage, but no trap.
RASTER_FN Real exp2_of(Real x) {
    Real shifted = x + EXP2_ROUNDER;
    Real f = x - (shifted - EXP2_ROUNDER);
    const float c[] = EXP2_COEFFICIENTS;
    Real p = ((((f * c[0] + c[1]) * f + c[2]) * f + c[3]) * f + c[4]) * f + c[5];
    return (Real)((Mask)p + ((Mask)shifted << 23));
}

// log2(x) for normal x > 0, absolute error 3e-7 near 1.
RASTER_FN Real log2_of(Real x) {
    Mask bits = (Mask)x;
    Mask exponent = (bits - 0x3f3504f3) >> 23;  // mantissa in [sqrt(1/2), sqrt(2))
    Real t = (Real)(bits - (exponent << 23)) - 1.0f;
    Real p = t * 0.125837057f - 0.207269824f;
    p = p * t + 0.215715621f;
    p = p * t - 0.238944808f;
    p = p * t + 0.287916251f;
    p = p * t - 0.36070368f;
    p = p * t + 0.480910642f;
    p = p * t - 0.721347348f;
    p = p * t + 1.442695f;
    return __builtin_convertvector(exponent, Real) + p * t;
}

RASTER_FN Real gather(const float* p, const int* index, int stride) {
    Real r;
    for (int i = 0; i < LANES; i++) r[i] = p[(long long)index[i] * stride];
    return r;
}

RASTER_FN bool any(Mask m) {
    typedef long long Halves __attribute__((vector_size(32)));
    Halves h = (Halves)m;
    return ((h[0] | h[1]) | (h[2] | h[3])) != 0;
}

RASTER_FN float sum(Real v) {
    return ((v[0] + v[4]) + (v[2] + v[6])) + ((v[1] + v[5]) + (v[3] + v[7]));
}

RASTER_FN Real load(const float* p) {
    Real r;
    __builtin_memcpy(&r, p, sizeof(r));
    return r;
}

RASTER_FN void store(float* p, Real r) { __builtin_memcpy(p, &r, sizeof(r)); }

// Hands out the chunks of a stage to whichever thread is free.
RASTER_FN int take(int* counter) { return __atomic_fetch_add(counter, 1, __ATOMIC_RELAXED); }

#endif

RASTER_FN Real least(Real a, Real b) { return select(a < b, a, b); }
RASTER_FN Real greatest(Real a, Real b) { return select(a > b, a, b); }
RASTER_FN Real clamp(Real x, float low, float high) { return least(greatest(x, splat(low)), splat(high)); }
RASTER_FN Real exponential(Real x) { return exp2_of(clamp(x * RASTER_LOG2_E, -126.0f, 126.0f)); }

}  // namespace raster
