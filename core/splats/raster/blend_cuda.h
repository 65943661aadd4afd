// Blending of a tile's Gaussians front to back on CUDA, and its gradient: a block is a tile, a thread a pixel.
#pragma once

namespace raster {

enum {
    TILE_PIXELS = TILE_WIDTH * TILE_HEIGHT,
    WARPS = TILE_PIXELS / 32,
    QUARTERS = 3,       // of a Splat's 16 floats that blending reads, four at a time
    GRADIENT_BATCH = 32  // Gaussians whose sums the warps leave in shared memory before they are added up
};

struct Pixel {
    int x, y;
    size_t index;
    bool inside;
    float center_x, center_y;
    template <class State>
    RASTER_FN_MEMBER Pixel(State& s, int tile, int thread) {
        x = tile % s.tiles_x * TILE_WIDTH + thread % TILE_WIDTH;
        y = tile / s.tiles_x * TILE_HEIGHT + thread / TILE_WIDTH;
        inside = x < s.width && y < s.height;
        index = (size_t)y * s.width + x;
        center_x = (float)x + 0.5f;
        center_y = (float)y + 0.5f;
    }
};

// The first twelve floats of a Splat, as three vectors.
struct Near {
    float4 a, b, c;  // x y xx xy | yy opacity red green | blue depth cutoff extent_x
    RASTER_FN_MEMBER float exponent(float dx, float dy) const { return (a.z * dx + a.w * dy) * dx + b.x * dy * dy; }
};

template <class State>
RASTER_FN void fetch(State& s, int k, float4* shared) {
    const float4* from = reinterpret_cast<const float4*>(s.splats.data + (size_t)s.list_gaussian.data[k] * SPLAT_FLOATS);
    for (int i = 0; i < QUARTERS; i++) shared[i] = from[i];
}

RASTER_FN Near read(const float4* shared) {
    Near n = {shared[0], shared[1], shared[2]};
    return n;
}

template <class State>
RASTER_FN void forward_tile(State& s, int tile, int thread) {
    __shared__ float4 batch[TILE_PIXELS * QUARTERS];
    const Camera& c = *reinterpret_cast<const Camera*>(s.camera.data);
    Pixel pixel(s, tile, thread);
    float transmittance = pixel.inside ? 1.0f : 0.0f, red = 0.0f, green = 0.0f, blue = 0.0f, depth = 0.0f;
    int begin = s.tile_start.data[tile], end = s.tile_start.data[tile + 1];
    for (int first = begin; first < end; first += TILE_PIXELS) {
        if (__syncthreads_and(transmittance < RASTER_TRANSMITTANCE_MIN)) break;
        if (first + thread < end) fetch(s, first + thread, batch + thread * QUARTERS);
        __syncthreads();
        int count = imin(TILE_PIXELS, end - first);
        for (int j = 0; j < count && transmittance >= RASTER_TRANSMITTANCE_MIN; j++) {
            Near g = read(batch + j * QUARTERS);
            float exponent = g.exponent(pixel.center_x - g.a.x, pixel.center_y - g.a.y);
            if (exponent < g.c.z) continue;
            float weight = fminf(exp2f(exponent) * g.b.y, RASTER_ALPHA_MAX) * transmittance;
            red += weight * g.b.z;
            green += weight * g.b.w;
            blue += weight * g.c.x;
            depth += weight * g.c.y;
            transmittance -= weight;
        }
    }
    if (!pixel.inside) return;
    s.color.data[3 * pixel.index] = red + transmittance * c.background[0];
    s.color.data[3 * pixel.index + 1] = green + transmittance * c.background[1];
    s.color.data[3 * pixel.index + 2] = blue + transmittance * c.background[2];
    s.depth.data[pixel.index] = depth;
    s.alpha.data[pixel.index] = 1.0f - transmittance;
}

// As on the CPU, front to back. Sums over a warp go through shuffles, sums over the warps through shared memory in
// fixed order: no atomics, the same bits every time.
template <class State>
RASTER_FN void backward_tile(State& s, int tile, int thread) {
    __shared__ float4 batch[GRADIENT_BATCH * QUARTERS];
    __shared__ float partial[WARPS * GRADIENT_BATCH * MOMENTS];
    const Camera& c = *reinterpret_cast<const Camera*>(s.camera.data);
    Pixel pixel(s, tile, thread);
    int warp = thread / 32;
    float b0 = c.background[0], b1 = c.background[1], b2 = c.background[2];
    float transmittance = pixel.inside ? 1.0f : 0.0f, behind = 0.0f;
    float grad_red = 0.0f, grad_green = 0.0f, grad_blue = 0.0f, grad_depth = 0.0f, grad_alpha = 0.0f;
    if (pixel.inside) {
        const float *g = s.grad_color.data + 3 * pixel.index, *color = s.color.data + 3 * pixel.index;
        grad_red = g[0];
        grad_green = g[1];
        grad_blue = g[2];
        behind = g[0] * (color[0] - b0) + g[1] * (color[1] - b1) + g[2] * (color[2] - b2);
        if (s.with_depth) {
            grad_depth = s.grad_depth.data[pixel.index];
            grad_alpha = s.grad_alpha.data[pixel.index];
            behind += grad_depth * s.depth.data[pixel.index] + grad_alpha * s.alpha.data[pixel.index];
        }
    }
    int begin = s.tile_start.data[tile], end = s.tile_start.data[tile + 1], first = begin;
    for (; first < end; first += GRADIENT_BATCH) {
        if (__syncthreads_and(transmittance < RASTER_TRANSMITTANCE_MIN)) break;
        if (thread < GRADIENT_BATCH && first + thread < end) fetch(s, first + thread, batch + thread * QUARTERS);
        __syncthreads();
        int count = imin(GRADIENT_BATCH, end - first);
        for (int j = 0; j < count; j++) {
            Near g = read(batch + j * QUARTERS);
            float dx = pixel.center_x - g.a.x, dy = pixel.center_y - g.a.y, exponent = g.exponent(dx, dy);
            bool blended = exponent >= g.c.z && transmittance >= RASTER_TRANSMITTANCE_MIN;
            float* out = partial + (warp * GRADIENT_BATCH + j) * MOMENTS;
            if (!__any_sync(0xffffffffu, blended)) {
                if (thread % 32 < MOMENTS) out[thread % 32] = 0.0f;
                continue;
            }
            float sums[MOMENTS];
#pragma unroll
            for (int m = 0; m < MOMENTS; m++) sums[m] = 0.0f;
            if (blended) {
                float raw = exp2f(exponent) * g.b.y, alpha = fminf(raw, RASTER_ALPHA_MAX);
                float weight = alpha * transmittance;
                transmittance -= weight;
                float own = weight * (grad_red * (g.b.z - b0) + grad_green * (g.b.w - b1) + grad_blue * (g.c.x - b2) +
                                      grad_depth * g.c.y + grad_alpha);
                behind -= own;
                float slope = raw <= RASTER_ALPHA_MAX ? own - behind * alpha / (1.0f - alpha) : 0.0f;
                sums[0] = weight * grad_red;
                sums[1] = weight * grad_green;
                sums[2] = weight * grad_blue;
                sums[3] = weight * grad_depth;
                sums[4] = slope;
                sums[5] = slope * dx;
                sums[6] = slope * dy;
                sums[7] = sums[5] * dx;
                sums[8] = sums[5] * dy;
                sums[9] = sums[6] * dy;
                sums[10] = fabsf(slope * (2.0f * g.a.z * dx + g.a.w * dy)) * RASTER_LN_2;
                sums[11] = fabsf(slope * (2.0f * g.b.x * dy + g.a.w * dx)) * RASTER_LN_2;
            }
#pragma unroll
            for (int m = 0; m < MOMENTS; m++) {
#pragma unroll
                for (int distance = 16; distance > 0; distance /= 2)
                    sums[m] += __shfl_xor_sync(0xffffffffu, sums[m], distance);
            }
            if (thread % 32 == 0) {
#pragma unroll
                for (int m = 0; m < MOMENTS; m++) out[m] = sums[m];
            }
        }
        __syncthreads();
        for (int i = thread; i < count * MOMENTS; i += TILE_PIXELS) {
            float total = 0.0f;
            for (int w = 0; w < WARPS; w++) total += partial[w * GRADIENT_BATCH * MOMENTS + i];
            s.moments.data[(size_t)s.list_slot.data[first + i / MOMENTS] * MOMENTS + i % MOMENTS] = total;
        }
    }
    for (size_t i = (size_t)first * MOMENTS + thread; i < (size_t)end * MOMENTS; i += TILE_PIXELS)
        s.moments.data[(size_t)s.list_slot.data[i / MOMENTS] * MOMENTS + i % MOMENTS] = 0.0f;
}

}  // namespace raster
