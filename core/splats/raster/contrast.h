// Contrast hinge: differences of neighbouring pixels, in CIELAB as an observer sees them, that a rendering lacks.
//
// x = Lab(S(clip(rendering))), t = Lab(S(target)); of a pair of neighbours p = x_j - x_i, q = t_j - t_i, n = |q|:
//     1 [n >= threshold and the pair is listed] max(0, min(n, cap) - p q / n)  +  invented 1 [else] max(0, |p| - max(n, floor))
#pragma once

namespace raster {

enum { CONTRAST_DIRECTIONS = 4, PIXELS_A_CHUNK = 2048 };
// `contrast_observer`: matrices of S above and below its separating plane, the plane, linear sRGB to XYZ over white.
enum { OBSERVER_ABOVE = 0, OBSERVER_BELOW = 9, OBSERVER_PLANE = 18, OBSERVER_XYZ = 21 };

#define SRGB_KNEE 0.04045f
#define SRGB_OFFSET 0.055f
#define SRGB_SLOPE 12.92f
#define SRGB_EXPONENT 2.4f
#define LAB_KNEE (6.0f / 29.0f)

RASTER_FN Real power(Real base, float exponent) { return exp2_of(log2_of(base) * exponent); }

RASTER_FN void multiply(const float* matrix, const Real* from, Real* to) {
    for (int i = 0; i < 3; i++) to[i] = from[0] * matrix[3 * i] + from[1] * matrix[3 * i + 1] + from[2] * matrix[3 * i + 2];
}

RASTER_FN void multiply_transposed(const float* matrix, const Real* from, Real* to) {
    for (int i = 0; i < 3; i++) to[i] = from[0] * matrix[i] + from[1] * matrix[3 + i] + from[2] * matrix[6 + i];
}

// A pixel on its way through S to CIELAB, with what its gradient needs on the way back.
struct Observed {
    Real linear[3], unclipped[3], relative[3], root[3];
    Mask above;
};

RASTER_FN void observe(const float* observer, const Real* srgb, Observed& o) {
    for (int c = 0; c < 3; c++) {
        Real clipped = clamp(srgb[c], 0.0f, 1.0f);
        Real curved = power((greatest(clipped, splat(SRGB_KNEE)) + SRGB_OFFSET) * (1.0f / (1.0f + SRGB_OFFSET)), SRGB_EXPONENT);
        o.linear[c] = select(clipped > splat(SRGB_KNEE), curved, clipped * (1.0f / SRGB_SLOPE));
    }
    const float* plane = observer + OBSERVER_PLANE;
    o.above = o.linear[0] * plane[0] + o.linear[1] * plane[1] + o.linear[2] * plane[2] >= splat(0.0f);
    Real below[3], simulated[3];
    multiply(observer + OBSERVER_ABOVE, o.linear, o.unclipped);
    multiply(observer + OBSERVER_BELOW, o.linear, below);
    for (int c = 0; c < 3; c++) {
        o.unclipped[c] = select(o.above, o.unclipped[c], below[c]);
        simulated[c] = clamp(o.unclipped[c], 0.0f, 1.0f);
    }
    multiply(observer + OBSERVER_XYZ, simulated, o.relative);
    for (int c = 0; c < 3; c++) {
        const float knee = LAB_KNEE * LAB_KNEE * LAB_KNEE;
        Real straight = o.relative[c] * (1.0f / (3.0f * LAB_KNEE * LAB_KNEE)) + 4.0f / 29.0f;
        Real curved = power(greatest(o.relative[c], splat(knee)), 1.0f / 3.0f);
        o.root[c] = select(o.relative[c] > splat(knee), curved, straight);
    }
}

RASTER_FN void lab_of(const Observed& o, Real* lab) {
    lab[0] = o.root[1] * 116.0f - 16.0f;
    lab[1] = (o.root[0] - o.root[1]) * 500.0f;
    lab[2] = (o.root[1] - o.root[2]) * 200.0f;
}

// d/d(srgb) from d/d(Lab); zero where something was clipped.
RASTER_FN void observe_gradient(const float* observer, const Real* srgb, const Observed& o, const Real* d_lab, Real* d_srgb) {
    Real zero = splat(0.0f), one = splat(1.0f), d[3], above[3], below[3];
    d[0] = d_lab[1] * 500.0f;
    d[1] = d_lab[0] * 116.0f - d_lab[1] * 500.0f + d_lab[2] * 200.0f;
    d[2] = d_lab[2] * -200.0f;
    for (int c = 0; c < 3; c++) {
        const float knee = LAB_KNEE * LAB_KNEE * LAB_KNEE;
        Real slope = o.root[c] / (greatest(o.relative[c], splat(knee)) * 3.0f);
        d[c] *= select(o.relative[c] > splat(knee), slope, splat(1.0f / (3.0f * LAB_KNEE * LAB_KNEE)));
    }
    multiply_transposed(observer + OBSERVER_XYZ, d, above);
    for (int c = 0; c < 3; c++) {
        Real inside = select(o.unclipped[c] > zero, select(o.unclipped[c] < one, above[c], zero), zero);
        d[c] = inside;
    }
    multiply_transposed(observer + OBSERVER_ABOVE, d, above);
    multiply_transposed(observer + OBSERVER_BELOW, d, below);
    for (int c = 0; c < 3; c++) {
        Real slope = o.linear[c] * SRGB_EXPONENT / (greatest(srgb[c], splat(SRGB_KNEE)) + SRGB_OFFSET);
        slope = select(srgb[c] > splat(SRGB_KNEE), slope, splat(1.0f / SRGB_SLOPE));
        slope = select(srgb[c] > zero, select(srgb[c] < one, slope, zero), zero);
        d_srgb[c] = select(o.above, above[c], below[c]) * slope;
    }
}

// `contrast_lab` has six planes, Lab of the rendering and of the target, with a margin before and after each.
template <class State>
RASTER_FN long long lab_margin(State& s) { return s.width + 1 + LANES; }

template <class State>
RASTER_FN long long lab_stride(State& s) { return (long long)s.width * s.height + 2 * lab_margin(s); }

template <class State>
RASTER_FN float* lab_plane(State& s, int plane) { return s.contrast_lab.data + plane * lab_stride(s) + lab_margin(s); }

// Reads `count` pixels of the rendering or of the target.
template <class State>
RASTER_FN void read_pixels(State& s, bool target, long long pixel, int count, Real* srgb) {
    for (int c = 0; c < 3; c++) srgb[c] = splat(0.0f);
    for (int i = 0; i < count; i++)
        for (int c = 0; c < 3; c++) {
            long long at = 3 * (pixel + i) + c;
            float value = !target ? s.color.data[at]
                : s.target_is_bytes ? (float)s.target_bytes.data[at] * (1.0f / 255.0f) : s.target_floats.data[at];
            set_lane(srgb[c], i, value);
        }
}

template <class State>
RASTER_FN void observe_pixels(State& s, bool target, long long pixel, int count) {
    Real srgb[3], lab[3];
    Observed o;
    read_pixels(s, target, pixel, count, srgb);
    observe(s.contrast_observer.data, srgb, o);
    lab_of(o, lab);
    for (int c = 0; c < 3; c++) {
        float* plane = lab_plane(s, (target ? 3 : 0) + c) + pixel;
        if (count == LANES) store(plane, lab[c]);
        else
            for (int i = 0; i < count; i++) plane[i] = lane(lab[c], i);
    }
}

// Offset of the neighbour in a direction: right, below, below right, below left.
template <class State>
RASTER_FN int neighbour(State& s, int direction) {
    const int right[CONTRAST_DIRECTIONS] = {1, 0, 1, -1};
    return right[direction] + (direction == 0 ? 0 : s.width);
}

template <class State>
RASTER_FN bool has_neighbour(State& s, long long pixel, int direction) {
    int column = (int)(pixel % s.width);
    if (direction != 0 && pixel / s.width == s.height - 1) return false;
    return direction == 1 || (direction == 3 ? column > 0 : column < s.width - 1);
}

// Bits of a pixel in `contrast_pairs`: 1 << d, its pair in direction d is listed; 16 << d, there is such a pair.
template <class State>
RASTER_FN void list_pairs(State& s, long long pixel) {
    int bits = 0;
    for (int d = 0; d < CONTRAST_DIRECTIONS; d++) {
        if (!has_neighbour(s, pixel, d)) continue;
        float squares = 0.0f;
        for (int c = 3; c < 6; c++) {
            const float* plane = lab_plane(s, c) + pixel;
            float difference = plane[neighbour(s, d)] - plane[0];
            squares += difference * difference;
        }
        bits |= 16 << d;
        if (squares >= s.contrast_listed * s.contrast_listed) bits |= 1 << d;
    }
    s.contrast_pairs.data[pixel] = (unsigned char)bits;
}

// Adds to `grad_color` what a pixel's eight pairs ask for.
template <class State>
RASTER_FN void contrast_gradient(State& s, long long pixel, int count) {
    long long pixels = (long long)s.width * s.height;
    Real zero = splat(0.0f), d_lab[3] = {zero, zero, zero};
    Real here[6];
    for (int c = 0; c < 6; c++) here[c] = load(lab_plane(s, c) + pixel);
    for (int d = 0; d < CONTRAST_DIRECTIONS; d++)
        for (int side = -1; side <= 1; side += 2) {
            long long step = (long long)side * neighbour(s, d);
            Real listed = zero, exists = zero;
            for (int i = 0; i < count; i++) {
                long long owner = pixel + i + (side < 0 ? step : 0);  // the bits are kept by a pair's first pixel
                if (owner < 0 || owner >= pixels) continue;
                int bits = s.contrast_pairs.data[owner];
                set_lane(listed, i, (float)(bits >> d & 1));
                set_lane(exists, i, (float)(bits >> d >> 4 & 1));
            }
            Real p[3], q[3];
            for (int c = 0; c < 3; c++) {
                p[c] = load(lab_plane(s, c) + pixel + step) - here[c];
                q[c] = load(lab_plane(s, 3 + c) + pixel + step) - here[3 + c];
            }
            Real n = square_root(q[0] * q[0] + q[1] * q[1] + q[2] * q[2]);
            Real along = (p[0] * q[0] + p[1] * q[1] + p[2] * q[2]) / greatest(n, splat(1e-6f));
            Mask distinct = listed * n >= splat(s.contrast_threshold);
            Real lacks = select(distinct, select(least(n, splat(s.contrast_cap)) > along, splat(1.0f), zero), zero);
            for (int c = 0; c < 3; c++) d_lab[c] += lacks * q[c] / greatest(n, splat(1e-6f));
            if (s.contrast_invented > 0.0f) {
                Real length = square_root(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
                Mask too_far = length > greatest(n, splat(s.contrast_floor));
                Real invents = select(distinct, zero, select(too_far, exists * s.contrast_invented, zero));
                for (int c = 0; c < 3; c++) d_lab[c] -= invents * p[c] / greatest(length, splat(1e-6f));
            }
        }
    Real srgb[3], d_srgb[3];
    Observed o;
    read_pixels(s, false, pixel, count, srgb);
    observe(s.contrast_observer.data, srgb, o);
    observe_gradient(s.contrast_observer.data, srgb, o, d_lab, d_srgb);
    for (int i = 0; i < count; i++)
        for (int c = 0; c < 3; c++) s.grad_color.data[3 * (pixel + i) + c] += s.contrast_scale * lane(d_srgb[c], i);
}

#if defined(__CUDACC__)

template <class State>
RASTER_FN void observe_one(State& s, int pixel) {
    observe_pixels(s, true, pixel, 1);
    if (!s.contrast_targets_only) observe_pixels(s, false, pixel, 1);
}

template <class State>
RASTER_FN void contrast_gradient_one(State& s, int pixel) { contrast_gradient(s, pixel, 1); }

#else

template <class State>
RASTER_FN void observe_stage(State& s) {
    long long pixels = (long long)s.width * s.height;
    for (long long chunk; (chunk = take(s.counters.data + STAGE_OBSERVE)) * PIXELS_A_CHUNK < pixels;) {
        long long first = chunk * PIXELS_A_CHUNK, end = first + PIXELS_A_CHUNK < pixels ? first + PIXELS_A_CHUNK : pixels;
        for (long long p = first; p < end; p += LANES) {
            int count = (int)(end - p < LANES ? end - p : LANES);
            observe_pixels(s, true, p, count);
            if (!s.contrast_targets_only) observe_pixels(s, false, p, count);
        }
    }
}

template <class State>
RASTER_FN void pairs_stage(State& s) {
    long long pixels = (long long)s.width * s.height;
    for (long long chunk; (chunk = take(s.counters.data + STAGE_PAIRS)) * PIXELS_A_CHUNK < pixels;)
        for (long long p = chunk * PIXELS_A_CHUNK; p < pixels && p < (chunk + 1) * PIXELS_A_CHUNK; p++) list_pairs(s, p);
}

template <class State>
RASTER_FN void contrast_stage(State& s) {
    long long pixels = (long long)s.width * s.height;
    for (long long chunk; (chunk = take(s.counters.data + STAGE_CONTRAST)) * PIXELS_A_CHUNK < pixels;) {
        long long first = chunk * PIXELS_A_CHUNK, end = first + PIXELS_A_CHUNK < pixels ? first + PIXELS_A_CHUNK : pixels;
        for (long long p = first; p < end; p += LANES)
            contrast_gradient(s, p, (int)(end - p < LANES ? end - p : LANES));
    }
}

#endif

}  // namespace raster
