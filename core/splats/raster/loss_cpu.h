// Fused photometric loss and its gradient on the CPU, in strips of rows with rolling windows, so that nothing but the
// images passes through main memory. Rows are kept as they lie there, colours interleaved: a tap is three floats apart.
#pragma once

namespace raster {

enum {
    STRIP_ROWS = 48,
    ROW_PAD = 16,        // zero floats on both sides of a row: 3 * RADIUS, rounded up to whole vectors
    INPUT_MAPS = 4,      // x, y, x^2 + y^2, x y
    DERIVATIVE_MAPS = 3  // of SSIM with respect to the windowed x, x^2 and x y
};
static const float WINDOW[RADIUS + 1] = SSIM_WINDOW;

// Floats of one row of a map, padding included, and of a worker's scratch memory; also in runner_cpu.py.
RASTER_FN int row_stride(int width) { return (3 * width + 7) / 8 * 8 + 2 * ROW_PAD; }

struct LossRows {  // rings of rows; row r lies in slot r mod TAPS
    float *inputs, *derivatives, *vertical, *pointwise, *weight;
    int stride;
    RASTER_FN_MEMBER float* input(int map, int row) const {
        return inputs + (long long)(map * TAPS + row % TAPS) * stride + ROW_PAD;
    }
    RASTER_FN_MEMBER float* derivative(int map, int row) const {
        return derivatives + (long long)(map * TAPS + row % TAPS) * stride + ROW_PAD;
    }
    RASTER_FN_MEMBER float* weights(int row) const { return weight + (long long)(row % TAPS) * stride + ROW_PAD; }
};

template <class State>
RASTER_FN LossRows loss_rows(State& s, int worker) {
    int stride = row_stride(s.width);
    const int rows = (INPUT_MAPS + DERIVATIVE_MAPS + 1) * TAPS + INPUT_MAPS + DERIVATIVE_MAPS + 1;
    LossRows l;
    l.stride = stride;
    l.inputs = s.loss_scratch.data + (long long)worker * rows * stride;
    l.derivatives = l.inputs + (long long)INPUT_MAPS * TAPS * stride;
    l.weight = l.derivatives + (long long)DERIVATIVE_MAPS * TAPS * stride;
    l.vertical = l.weight + (long long)TAPS * stride + ROW_PAD;
    l.pointwise = l.vertical + (long long)INPUT_MAPS * stride;
    return l;
}

// Reads row `row` of both images into the rings, multiplied by the mask.
template <class State>
RASTER_FN void read_row(State& s, const LossRows& l, int row) {
    int n = 3 * s.width;
    long long first = (long long)row * n;
    float *x = l.input(0, row), *y = l.input(1, row), *squares = l.input(2, row), *product = l.input(3, row);
    const float* color = s.color.data + first;
    if (s.target_is_bytes) {
        const unsigned char* bytes = s.target_bytes.data + first;
        for (int i = 0; i < n; i++) y[i] = (float)bytes[i] * (1.0f / 255.0f);
    } else {
        const float* target = s.target_floats.data + first;
        for (int i = 0; i < n; i++) y[i] = target[i];
    }
    if (s.mask_kind) {
        float* weight = l.weights(row);
        for (int i = 0; i < s.width; i++) {
            long long p = (long long)row * s.width + i;
            float m = s.mask_kind == 1 ? s.mask_floats.data[p] : (float)s.mask_bytes.data[p] * (1.0f / 255.0f);
            weight[3 * i] = weight[3 * i + 1] = weight[3 * i + 2] = m;
        }
        for (int i = 0; i < n; i++) {
            x[i] = color[i] * weight[i];
            y[i] = y[i] * weight[i];
        }
    } else {
        for (int i = 0; i < n; i++) x[i] = color[i];
    }
    for (int i = 0; i < n; i++) {
        squares[i] = x[i] * x[i] + y[i] * y[i];
        product[i] = x[i] * y[i];
    }
}

// rows[k] points at the row at offset k - RADIUS, or at a row of zeros outside the image.
RASTER_FN Real down(const float* const* rows, int i) {
    Real sum = load(rows[RADIUS] + i) * WINDOW[0];
    for (int k = 1; k <= RADIUS; k++) sum += (load(rows[RADIUS - k] + i) + load(rows[RADIUS + k] + i)) * WINDOW[k];
    return sum;
}

RASTER_FN Real across(const float* row) {
    Real sum = load(row) * WINDOW[0];
    for (int k = 1; k <= RADIUS; k++) sum += (load(row - 3 * k) + load(row + 3 * k)) * WINDOW[k];
    return sum;
}

// SSIM of row `row` and its derivatives; returns the (masked) sum of the map over the row.
template <class State>
static inline double ssim_row(State& s, const LossRows& l, int row, const float* zeros) {
    int n = 3 * s.width, stride = l.stride;
    const float* weights = s.mask_kind ? l.weights(row) : nullptr;
    for (int map = 0; map < INPUT_MAPS; map++) {
        const float* rows[TAPS];
        for (int k = 0; k < TAPS; k++) {
            int r = row + k - RADIUS;
            rows[k] = r >= 0 && r < s.height ? l.input(map, r) : zeros;
        }
        float* out = l.vertical + (long long)map * stride;
        for (int i = 0; i < n; i += LANES) store(out + i, down(rows, i));
    }
    const float* v = l.vertical;
    float* q = l.pointwise;
    Real total = splat(0.0f);
    for (int i = 0; i < n; i += LANES) {
        Real mx = across(v + i), my = across(v + stride + i);
        Real squares = across(v + 2 * stride + i), product = across(v + 3 * stride + i);
        Similarity r = similarity(mx, my, squares, product, s.ssim_c2);
        if (weights) {
            Real m = load(weights + i);
            r.value *= m;
            r.d_mean *= m;
            r.d_squares *= m;
            r.d_product *= m;
        }
        if (i + LANES > n)
            for (int j = n - i; j < LANES; j++) r.value[j] = r.d_mean[j] = r.d_squares[j] = r.d_product[j] = 0.0f;
        total += r.value;
        store(q + i, r.d_mean);
        store(q + stride + i, r.d_squares);
        store(q + 2 * stride + i, r.d_product);
    }
    for (int map = 0; map < DERIVATIVE_MAPS; map++) {
        const float* from = q + (long long)map * stride;
        float* to = l.derivative(map, row);
        for (int i = 0; i < n; i += LANES) store(to + i, across(from + i));
    }
    return (double)sum(total);
}

// Gradient of row `row`; returns the sum of |x - y| over it.
template <class State>
static inline double gradient_row(State& s, const LossRows& l, int row, const float* zeros) {
    int n = 3 * s.width;
    const float* rows[DERIVATIVE_MAPS][TAPS];
    for (int map = 0; map < DERIVATIVE_MAPS; map++)
        for (int k = 0; k < TAPS; k++) {
            int r = row + k - RADIUS;
            rows[map][k] = r >= 0 && r < s.height ? l.derivative(map, r) : zeros;
        }
    const float *x = l.input(0, row), *y = l.input(1, row);
    float* out = s.grad_color.data + (long long)row * n;
    const float* weights = s.mask_kind ? l.weights(row) : nullptr;
    float l1_scale = s.l1_scale, ssim_scale = s.ssim_scale;
    Real total = splat(0.0f), zero = splat(0.0f);
    for (int i = 0; i < n; i += LANES) {
        Real vx = load(x + i), vy = load(y + i), difference = vx - vy;
        Real gradient = down(rows[0], i) + 2.0f * vx * down(rows[1], i) + vy * down(rows[2], i);
        Real sign = select(difference > zero, splat(l1_scale), select(difference < zero, splat(-l1_scale), zero));
        gradient = sign - ssim_scale * gradient;
        if (weights) gradient *= load(weights + i);
        total += (Real)((Mask)difference & 0x7fffffff);
        if (i + LANES <= n) store(out + i, gradient);
        else
            for (int j = 0; j < n - i; j++) out[i + j] = gradient[j];
    }
    return (double)sum(total);
}

// One strip: partial sums of |x - y| and of SSIM over its rows, and their gradient. What the rows above and below
// contribute is computed again, with the same arithmetic, so that strips depend on nothing but the images.
template <class State>
static inline void loss_strip(State& s, const LossRows& l, int strip) {
    int begin = strip * STRIP_ROWS, end = imin(begin + STRIP_ROWS, s.height);
    int first = imax(0, begin - RADIUS), last = imin(s.height, end + RADIUS);
    const float* zeros = l.pointwise + (long long)DERIVATIVE_MAPS * l.stride;
    double l1 = 0.0, ssim = 0.0;
    int read = imax(0, first - RADIUS);
    for (int row = first; row < last + RADIUS; row++) {
        if (row < last) {
            for (; read < imin(s.height, row + RADIUS + 1); read++) read_row(s, l, read);
            double of_row = ssim_row(s, l, row, zeros);
            if (row >= begin && row < end) ssim += of_row;
        }
        int finished = row - RADIUS;
        if (finished >= begin && finished < end) l1 += gradient_row(s, l, finished, zeros);
    }
    s.loss_partial.data[2 * strip] = l1;
    s.loss_partial.data[2 * strip + 1] = ssim;
}

template <class State>
RASTER_FN void loss_stage(State& s, int worker) {
    LossRows l = loss_rows(s, worker);
    for (int strip; (strip = take(s.counters.data + STAGE_LOSS)) * STRIP_ROWS < s.height;) loss_strip(s, l, strip);
}

}  // namespace raster
