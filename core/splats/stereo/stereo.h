// Depth of every pixel of a view on the CPU: plane sweep (Collins 1996) with normalised cross-correlation, semi-global
// smoothing (Hirschmueller 2008), and the best level with a parabola through its neighbours. One call is one view.
#pragma once

namespace raster {

enum {
    WINDOW_RADIUS = 2,
    PLANES = 7,          // products whose sums over a window the correlation needs
    MOST_NEIGHBOURS = 8,
    PAIR_FLOATS = 12     // of a homography that is linear in the inverse depth: a matrix and a column
};
#define STEREO_NOTHING 1e30f  // cost where a neighbour has nothing to compare

typedef float Pixel __attribute__((vector_size(16)));  // red, green, blue, coverage

RASTER_FN int padded(int n) { return (n + LANES - 1) / LANES * LANES; }

RASTER_FN Pixel load_pixel(const float* p) {
    Pixel r;
    __builtin_memcpy(&r, p, sizeof(r));
    return r;
}

// A worker's memory; `scratch_floats` in kernels.py counts it.
struct SweepMemory {
    float *cost, *smooth;   // pixels x levels
    float *planes, *summed; // PLANES x pixels
    float* pair;            // MOST_NEIGHBOURS x pixels
    float *rows, *line;     // of the smoothing
    template <class State>
    RASTER_FN_MEMBER SweepMemory(State& s, int worker) {
        long long pixels = padded(s.most_pixels), levels = s.levels;
        cost = s.scratch.data + (long long)worker * s.scratch_floats;
        smooth = cost + pixels * levels;
        planes = smooth + pixels * levels;
        summed = planes + PLANES * pixels;
        pair = summed + PLANES * pixels;
        rows = pair + MOST_NEIGHBOURS * pixels;
        line = rows + pixels * (levels + 2 * LANES);
    }
};

struct SweptImage {
    const float* pixels;  // four floats each
    int width, height;
    template <class State>
    RASTER_FN_MEMBER SweptImage(State& s, int view) {
        pixels = s.images.data + 4ll * s.first_pixel.data[view];
        width = s.sizes.data[2 * view];
        height = s.sizes.data[2 * view + 1];
    }
};

// The products at one plane of depth: the view's grey value and that of its neighbour where both are covered.
template <class State>
RASTER_FN void sample_neighbour(State& s, const SweptImage& own, const SweptImage& other, const float* pair,
                                float inverse_depth, float* __restrict planes, int stride) {
    float column[3], corner[3];
    for (int i = 0; i < 3; i++) column[i] = pair[3 * i + 2] + inverse_depth * pair[9 + i];
    float last_x = (float)(other.width - 1), last_y = (float)(other.height - 1);
    for (int y = 0, p = 0; y < own.height; y++) {
        for (int i = 0; i < 3; i++) corner[i] = pair[3 * i] * 0.5f + pair[3 * i + 1] * ((float)y + 0.5f) + column[i];
        for (int x = 0; x < own.width; x++, p++) {
            Pixel mine = load_pixel(own.pixels + 4ll * p);
            float fx = (float)x, z = corner[2] + pair[6] * fx;
            float across = 1.0f / (z > 1e-6f ? z : 1.0f);
            float u = (corner[0] + pair[0] * fx) * across - 0.5f, v = (corner[1] + pair[3] * fx) * across - 0.5f;
            bool inside = z > 1e-6f && u >= -0.5f && v >= -0.5f && u < last_x + 0.5f && v < last_y + 0.5f;
            u = inside && u > 0.0f ? (u < last_x ? u : last_x) : 0.0f;
            v = inside && v > 0.0f ? (v < last_y ? v : last_y) : 0.0f;
            int left = imin((int)u, other.width - 2), top = imin((int)v, other.height - 2);
            float right = u - (float)left, low = v - (float)top;
            const float* at = other.pixels + 4ll * (top * other.width + left);
            const float* below = at + 4ll * other.width;
            Pixel upper = load_pixel(at), lower = load_pixel(below);
            upper += right * (load_pixel(at + 4) - upper);
            lower += right * (load_pixel(below + 4) - lower);
            Pixel theirs = upper + low * (lower - upper);
            float mask = inside && mine[3] >= 0.5f && theirs[3] >= 0.5f ? 1.0f : 0.0f;
            float a = mask * (0.299f * mine[0] + 0.587f * mine[1] + 0.114f * mine[2]);
            float b = mask * (0.299f * theirs[0] + 0.587f * theirs[1] + 0.114f * theirs[2]);
            Pixel d = mine - theirs;
            planes[p] = mask;
            planes[stride + p] = a;
            planes[2 * stride + p] = b;
            planes[3 * stride + p] = a * a;
            planes[4 * stride + p] = b * b;
            planes[5 * stride + p] = a * b;
            planes[6 * stride + p] =
                mask * (__builtin_fabsf(d[0]) + __builtin_fabsf(d[1]) + __builtin_fabsf(d[2])) * (1.0f / 3.0f);
        }
    }
}

// Sums over windows, which the border of the image cuts off.
RASTER_FN void sum_windows(const float* __restrict from, float* __restrict to, float* __restrict column, int width,
                           int height) {
    for (int i = 0; i < WINDOW_RADIUS; i++) column[i] = column[WINDOW_RADIUS + width + i] = 0.0f;
    float* middle = column + WINDOW_RADIUS;
    for (int y = 0; y < height; y++) {
        int top = imax(y - WINDOW_RADIUS, 0), bottom = imin(y + WINDOW_RADIUS, height - 1);
        for (int x = 0; x < width; x++) middle[x] = from[top * width + x];
        for (int row = top + 1; row <= bottom; row++)
            for (int x = 0; x < width; x++) middle[x] += from[row * width + x];
        for (int x = 0; x < width; x++)
            to[y * width + x] = column[x] + column[x + 1] + column[x + 2] + column[x + 3] + column[x + 4];
    }
}

// Cost of the windows' disagreement: 1 - correlation, from 0 to 1, and some of the difference in colour.
template <class State>
RASTER_FN void compare_windows(State& s, const float* __restrict planes, const float* __restrict summed, int stride,
                               int pixels, float* __restrict cost) {
    float noise = s.noise, weight = s.color_weight, most = s.most_difference;
    for (int p = 0; p < pixels; p++) {
        float n = summed[p], inverse = 1.0f / (n > 1.0f ? n : 1.0f);
        float a = summed[stride + p] * inverse, b = summed[2 * stride + p] * inverse;
        float aa = summed[3 * stride + p] * inverse - a * a, bb = summed[4 * stride + p] * inverse - b * b;
        float ab = summed[5 * stride + p] * inverse - a * b;
        aa = (aa > 0.0f ? aa : 0.0f) + noise;
        bb = (bb > 0.0f ? bb : 0.0f) + noise;
        float unlike = 1.0f - ab / __builtin_sqrtf(aa * bb);
        unlike = unlike < 0.0f ? 0.0f : unlike > 1.0f ? 1.0f : unlike;
        float difference = summed[6 * stride + p] * inverse;
        float found = unlike + weight * (difference < most ? difference : most);
        cost[p] = planes[p] > 0.0f && n >= 6.0f ? found : STEREO_NOTHING;
    }
}

// Mean of the better half of what the neighbours say, which those that are occluded do not spoil.
RASTER_FN void better_half(const float* pair, int neighbours, int stride, int pixels, float unseen, int levels,
                           float* cost) {
    for (int p = 0; p < pixels; p += LANES) {
        Real found[MOST_NEIGHBOURS], count = splat(0.0f), one = splat(1.0f), zero = splat(0.0f);
        for (int k = 0; k < neighbours; k++) {
            Real next = load(pair + (long long)k * stride + p);
            count += select(next < splat(STEREO_NOTHING), one, zero);
            for (int i = 0; i < k; i++) {
                Real low = least(found[i], next);
                next = greatest(found[i], next);
                found[i] = low;
            }
            found[k] = next;
        }
        Real half = floor_of((count + 1.0f) * 0.5f), sum = zero;
        for (int k = 0; k < neighbours; k++) sum += select(splat((float)k) < half, found[k], zero);
        Real mean = select(half > zero, sum / greatest(half, one), splat(unseen));
        for (int i = 0; i < imin(LANES, pixels - p); i++) cost[(long long)(p + i) * levels] = mean[i];
    }
}

template <class State>
RASTER_FN void match(State& s, const SweepMemory& m, const SweptImage& own, int view) {
    int pixels = own.width * own.height, stride = padded(s.most_pixels);
    const int* neighbours = s.neighbours.data + (long long)view * s.neighbour_count;
    int count = 0;
    while (count < s.neighbour_count && neighbours[count] >= 0) count++;
    const float* range = s.ranges.data + 2 * view;
    for (int p = pixels; p < padded(pixels); p++)
        for (int k = 0; k < count; k++) m.pair[(long long)k * stride + p] = STEREO_NOTHING;
    for (int level = 0; level < s.levels; level++) {
        for (int k = 0; k < count; k++) {
            SweptImage other(s, neighbours[k]);
            const float* pair = s.pairs.data + ((long long)view * s.neighbour_count + k) * PAIR_FLOATS;
            sample_neighbour(s, own, other, pair, range[0] + (float)level * range[1], m.planes, stride);
            for (int i = 0; i < PLANES; i++)
                sum_windows(m.planes + (long long)i * stride, m.summed + (long long)i * stride, m.rows, own.width,
                            own.height);
            compare_windows(s, m.planes, m.summed, stride, pixels, m.pair + (long long)k * stride);
        }
        better_half(m.pair, count, stride, pixels, s.unseen, s.levels, m.cost + level);
    }
}

// One step of a path: adds to `smooth` and turns `before`, the path's costs at the last pixel, into those at this one.
// `before` has LANES floats of padding on both sides.
template <class State>
RASTER_FN void advance(State& s, const float* cost, float* before, float* now, float* smooth, bool begins) {
    int levels = s.levels;
    if (begins) {
        for (int d = 0; d < levels; d++) now[d] = cost[d];
    } else {
        float lowest = before[0];
        for (int d = 1; d < levels; d++) lowest = before[d] < lowest ? before[d] : lowest;
        Real jump = splat(lowest + s.large_step), floor = splat(lowest);
        for (int d = 0; d < levels; d += LANES) {
            Real best = least(load(before + d), jump);
            best = least(best, least(load(before + d - 1), load(before + d + 1)) + s.small_step);
            store(now + d, load(cost + d) + best - floor);
        }
    }
    now[-1] = now[levels] = STEREO_NOTHING;
    for (int d = 0; d < levels; d++) smooth[d] += now[d];
}

template <class State>
RASTER_FN void smooth_costs(State& s, const SweepMemory& m, int width, int height) {
    long long levels = s.levels, padded_levels = levels + 2 * LANES;
    for (long long i = 0; i < (long long)width * height * levels; i++) m.smooth[i] = 0.0f;
    for (int direction = 0; direction < 2; direction++) {
        for (int y = 0; y < height; y++) {
            float *before = m.line + LANES, *now = before + padded_levels;
            for (int i = 0; i < width; i++) {
                long long p = (long long)y * width + (direction ? width - 1 - i : i);
                advance(s, m.cost + p * levels, before, now, m.smooth + p * levels, i == 0);
                float* swap = before;
                before = now;
                now = swap;
            }
        }
        for (int i = 0; i < height; i++) {
            for (int x = 0; x < width; x++) {
                long long p = (long long)(direction ? height - 1 - i : i) * width + x;
                float* now = m.line + LANES;
                float* before = m.rows + x * padded_levels + LANES;
                advance(s, m.cost + p * levels, before, now, m.smooth + p * levels, i == 0);
                for (int d = -1; d <= levels; d++) before[d] = now[d];
            }
        }
    }
}

// The inverse depth at the least smoothed cost; 0 where the view is not covered or nothing,
// be it far along a path, tells one depth from another.
template <class State>
RASTER_FN void choose_levels(State& s, const SweepMemory& m, const SweptImage& own, int view) {
    long long first = s.first_pixel.data[view];
    const float* range = s.ranges.data + 2 * view;
    for (int p = 0; p < own.width * own.height; p++) {
        const float* smooth = m.smooth + (long long)p * s.levels;
        int best = 0;
        float sum = smooth[0];
        for (int d = 1; d < s.levels; d++) {
            best = smooth[d] < smooth[best] ? d : best;
            sum += smooth[d];
        }
        float offset = 0.0f;
        if (best > 0 && best < s.levels - 1) {
            float below = smooth[best - 1] - smooth[best], above = smooth[best + 1] - smooth[best];
            if (below + above > 1e-6f) offset = 0.5f * (below - above) / (below + above);
        }
        bool told = own.pixels[4ll * p + 3] >= 0.5f && sum / (float)s.levels - smooth[best] >= s.evidence;
        s.inverse_depth.data[first + p] = told ? range[0] + ((float)best + offset) * range[1] : 0.0f;
    }
}

template <class State>
RASTER_FN void stereo_stage(State& s, int worker) {
    SweepMemory m(s, worker);
    for (int view; (view = take(s.counter.data)) < s.views;) {
        SweptImage own(s, view);
        match(s, m, own, view);
        smooth_costs(s, m, own.width, own.height);
        choose_levels(s, m, own, view);
    }
}

}  // namespace raster
