// Adam (Kingma and Ba 2015) over all parameters of the Gaussians that took part in the step.
#pragma once

namespace raster {

// What a step multiplies with, per Gaussian; zero `taken` leaves moments and parameters as they are.
struct AdamFactors {
    float taken;              // 0 or 1
    float inverse_bias1;      // taken / (1 - beta1^t)
    float inverse_root_bias2; // 1 / sqrt(1 - beta2^t)
};

// Calls group(leading arguments..., width, head, rate of the first `head` floats, rate of the rest, arrays...) for every
// parameter group; for the colours of degree 0 alone where nothing else has a gradient.
#define ADAM_ARRAYS(s, name) s.name.data, s.m_##name.data, s.v_##name.data, s.grad_##name.data
#define ADAM_GROUPS(group, s, ...)                                                                                  \
    if (s.colors_only == 0) {                                                                                       \
        group(s, __VA_ARGS__, 3, 3, s.rate_means, 0.0f, ADAM_ARRAYS(s, means));                                     \
        group(s, __VA_ARGS__, 3, 3, s.rate_log_scales, 0.0f, ADAM_ARRAYS(s, log_scales));                           \
        group(s, __VA_ARGS__, 4, 4, s.rate_quaternions, 0.0f, ADAM_ARRAYS(s, quaternions));                         \
        group(s, __VA_ARGS__, 1, 1, s.rate_opacity_logits, 0.0f, ADAM_ARRAYS(s, opacity_logits));                   \
    }                                                                                                               \
    group(s, __VA_ARGS__, 3 * s.sh_count, 3, s.rate_sh0, s.colors_only ? 0.0f : s.rate_sh_rest, ADAM_ARRAYS(s, sh));

// Counts the step for Gaussian n and looks its bias corrections up; t beyond the table's end reads its last entry.
template <class State>
RASTER_FN AdamFactors adam_factors(State& s, int n) {
    AdamFactors f = {0.0f, 0.0f, 1.0f};
    if (!s.touched.data[n]) return f;
    int step = imin(s.adam_steps.data[n] + 1, s.adam_table_size - 1);
    s.adam_steps.data[n] = step;
    f.taken = 1.0f;
    f.inverse_bias1 = s.adam_bias.data[2 * step];
    f.inverse_root_bias2 = s.adam_bias.data[2 * step + 1];
    return f;
}

RASTER_FN void adam_element(float* parameter, float* moment1, float* moment2, float gradient, float taken,
                            float step_size, float inverse_root_bias2, float keep1, float keep2, float epsilon) {
    float m = *moment1 + taken * (1.0f - keep1) * (gradient - *moment1);
    float v = *moment2 + taken * (1.0f - keep2) * (gradient * gradient - *moment2);
    *moment1 = m;
    *moment2 = v;
    *parameter -= step_size * m / (sqrtf(v) * inverse_root_bias2 + epsilon);
}

#if defined(__CUDACC__)

template <class State>
RASTER_FN void adam_group(State& s, const AdamFactors& f, int n, int width, int head, float rate_head, float rate,
                          float* parameters, float* moment1, float* moment2, const float* gradients) {
    for (int j = 0; j < width; j++) {
        size_t e = (size_t)n * width + j;
        adam_element(parameters + e, moment1 + e, moment2 + e, gradients[e], f.taken,
                     f.inverse_bias1 * (j < head ? rate_head : rate), f.inverse_root_bias2, s.beta1, s.beta2,
                     s.epsilon);
    }
}

template <class State>
RASTER_FN void adam_one(State& s, int n) {
    AdamFactors f = adam_factors(s, n);
    if (f.taken == 0.0f) return;
    ADAM_GROUPS(adam_group, s, f, n)
}

#else

enum { ADAM_CHUNK = 64, ADAM_MAX_WIDTH = 48 };  // Gaussians a chunk; most floats a group has per Gaussian (SH degree 3)

// One group of `width` floats per Gaussian, `stride` apart. `rate` of the first `head` floats is `rate_head`.
template <class State>
static inline void adam_group(State& s, const AdamFactors* factors, int first, int count, int width, int head,
                              float rate_head, float rate, float* parameters, float* moment1, float* moment2,
                              const float* gradients) {
    float taken[ADAM_CHUNK * ADAM_MAX_WIDTH], step_size[ADAM_CHUNK * ADAM_MAX_WIDTH],
        root[ADAM_CHUNK * ADAM_MAX_WIDTH];
    for (int i = 0, e = 0; i < count; i++)
        for (int j = 0; j < width; j++, e++) {
            taken[e] = factors[i].taken;
            step_size[e] = factors[i].inverse_bias1 * (j < head ? rate_head : rate);
            root[e] = factors[i].inverse_root_bias2;
        }
    long long start = (long long)first * width;
    float *p = parameters + start, *m = moment1 + start, *v = moment2 + start;
    const float* g = gradients + start;
    float beta1 = s.beta1, beta2 = s.beta2, epsilon = s.epsilon;
    for (int e = 0; e < count * width; e++)
        adam_element(p + e, m + e, v + e, g[e], taken[e], step_size[e], root[e], beta1, beta2, epsilon);
}

template <class State>
RASTER_FN void adam_stage(State& s) {
    for (int chunk; (chunk = take(s.counters.data + STAGE_ADAM)) * ADAM_CHUNK < s.gaussians;) {
        int first = chunk * ADAM_CHUNK, count = imin(ADAM_CHUNK, s.gaussians - first);
        AdamFactors factors[ADAM_CHUNK];
        for (int i = 0; i < count; i++) factors[i] = adam_factors(s, first + i);
        ADAM_GROUPS(adam_group, s, factors, first, count)
    }
}

#endif

}  // namespace raster
