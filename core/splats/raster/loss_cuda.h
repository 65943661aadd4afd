// Photometric loss on CUDA in two passes: the SSIM map's derivatives, then their convolution. A block is a square of
// pixels; partial sums of a block are added in fixed order.
#pragma once

namespace raster {

enum { SQUARE = 16, SQUARE_PIXELS = SQUARE * SQUARE, HALO = SQUARE + 2 * RADIUS, HALO_PIXELS = HALO * HALO };

struct Block {
    int left, top, x, y;  // of the square, and of this thread's pixel
    bool inside;
    template <class State>
    RASTER_FN_MEMBER Block(State& s, int block, int thread) {
        int across = (s.width + SQUARE - 1) / SQUARE;
        left = block % across * SQUARE;
        top = block / across * SQUARE;
        x = left + thread % SQUARE;
        y = top + thread / SQUARE;
        inside = x < s.width && y < s.height;
    }
};

template <class State>
RASTER_FN float mask_at(State& s, size_t pixel) {
    if (s.mask_kind == 0) return 1.0f;
    return s.mask_kind == 1 ? s.mask_floats.data[pixel] : (float)s.mask_bytes.data[pixel] * (1.0f / 255.0f);
}

template <class State>
RASTER_FN float target_at(State& s, size_t value) {
    return s.target_is_bytes ? (float)s.target_bytes.data[value] * (1.0f / 255.0f) : s.target_floats.data[value];
}

// Windows the MAPS values of a halo along x, then along y; `rows` is scratch. Every thread of the block takes part.
template <int MAPS>
RASTER_FN void window(const float* halo, float* rows, int thread, float* out) {
    const float weights[RADIUS + 1] = SSIM_WINDOW;
    for (int i = thread; i < HALO * SQUARE; i += SQUARE_PIXELS) {
        int y = i / SQUARE, x = i % SQUARE + RADIUS;
#pragma unroll
        for (int m = 0; m < MAPS; m++) {
            const float* p = halo + m * HALO_PIXELS + y * HALO + x;
            float sum = p[0] * weights[0];
#pragma unroll
            for (int k = 1; k <= RADIUS; k++) sum += (p[-k] + p[k]) * weights[k];
            rows[m * HALO * SQUARE + i] = sum;
        }
    }
    __syncthreads();
#pragma unroll
    for (int m = 0; m < MAPS; m++) {
        const float* p = rows + m * HALO * SQUARE + thread + RADIUS * SQUARE;
        float sum = p[0] * weights[0];
#pragma unroll
        for (int k = 1; k <= RADIUS; k++) sum += (p[-k * SQUARE] + p[k * SQUARE]) * weights[k];
        out[m] = sum;
    }
    __syncthreads();
}

// Adds a value of every thread of the block, in the order of a tree; the result is thread 0's.
RASTER_FN double block_sum(double* shared, int thread, double value) {
    shared[thread] = value;
    __syncthreads();
    for (int half = SQUARE_PIXELS / 2; half > 0; half /= 2) {
        if (thread < half) shared[thread] += shared[thread + half];
        __syncthreads();
    }
    double sum = shared[0];
    __syncthreads();
    return sum;
}

// First pass: derivatives into `ssim_maps` (3, H, W, 3), partial sums of SSIM.
template <class State>
RASTER_FN void ssim_block(State& s, int block, int thread) {
    __shared__ float halo[4 * HALO_PIXELS];
    __shared__ float rows[4 * HALO * SQUARE];
    __shared__ double sums[SQUARE_PIXELS];
    Block b(s, block, thread);
    size_t pixel = (size_t)b.y * s.width + b.x, plane = (size_t)s.width * s.height * 3;
    float mask = b.inside ? mask_at(s, pixel) : 0.0f;
    double total = 0.0;
    for (int channel = 0; channel < 3; channel++) {
        for (int i = thread; i < HALO_PIXELS; i += SQUARE_PIXELS) {
            int x = b.left + i % HALO - RADIUS, y = b.top + i / HALO - RADIUS;
            float color = 0.0f, target = 0.0f;
            if (x >= 0 && x < s.width && y >= 0 && y < s.height) {
                size_t p = (size_t)y * s.width + x;
                float m = mask_at(s, p);
                color = s.color.data[3 * p + channel] * m;
                target = target_at(s, 3 * p + channel) * m;
            }
            halo[i] = color;
            halo[HALO_PIXELS + i] = target;
            halo[2 * HALO_PIXELS + i] = color * color + target * target;
            halo[3 * HALO_PIXELS + i] = color * target;
        }
        __syncthreads();
        float windowed[4];
        window<4>(halo, rows, thread, windowed);
        if (b.inside) {
            Similarity r = similarity(windowed[0], windowed[1], windowed[2], windowed[3], s.ssim_c2);
            total += (double)(r.value * mask);
            float* maps = s.ssim_maps.data + 3 * pixel + channel;
            maps[0] = r.d_mean * mask;
            maps[plane] = r.d_squares * mask;
            maps[2 * plane] = r.d_product * mask;
        }
    }
    double sum = block_sum(sums, thread, total);
    if (thread == 0) s.loss_partial.data[2 * block + 1] = sum;
}

// Second pass: dL/dcolor, partial sums of |x - y|.
template <class State>
RASTER_FN void loss_block(State& s, int block, int thread) {
    __shared__ float halo[3 * HALO_PIXELS];
    __shared__ float rows[3 * HALO * SQUARE];
    __shared__ double sums[SQUARE_PIXELS];
    Block b(s, block, thread);
    size_t pixel = (size_t)b.y * s.width + b.x, plane = (size_t)s.width * s.height * 3;
    float mask = b.inside ? mask_at(s, pixel) : 0.0f;
    double total = 0.0;
    for (int channel = 0; channel < 3; channel++) {
        for (int i = thread; i < HALO_PIXELS; i += SQUARE_PIXELS) {
            int x = b.left + i % HALO - RADIUS, y = b.top + i / HALO - RADIUS;
            bool within = x >= 0 && x < s.width && y >= 0 && y < s.height;
            size_t p = 3 * ((size_t)y * s.width + x) + channel;
            for (int m = 0; m < 3; m++) halo[m * HALO_PIXELS + i] = within ? s.ssim_maps.data[m * plane + p] : 0.0f;
        }
        __syncthreads();
        float windowed[3];
        window<3>(halo, rows, thread, windowed);
        if (b.inside) {
            float color = s.color.data[3 * pixel + channel] * mask, target = target_at(s, 3 * pixel + channel) * mask;
            float difference = color - target;
            float sign = difference > 0.0f ? s.l1_scale : (difference < 0.0f ? -s.l1_scale : 0.0f);
            float ssim = windowed[0] + 2.0f * color * windowed[1] + target * windowed[2];
            s.grad_color.data[3 * pixel + channel] = mask * (sign - s.ssim_scale * ssim);
            total += (double)fabsf(difference);
        }
    }
    double sum = block_sum(sums, thread, total);
    if (thread == 0) s.loss_partial.data[2 * block] = sum;
}

}  // namespace raster
