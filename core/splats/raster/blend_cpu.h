// Blending of a tile's Gaussians front to back on the CPU, and its gradient: one vector is one row of a tile.
#pragma once

namespace raster {

// A lane's transmittance turns negative once it is saturated: nothing more is blended there, its size is kept.
enum { GAUSSIANS_BETWEEN_CHECKS = 8 };
#define SIGN_BIT ((int)0x80000000)

struct Window {  // rows of the tile in which some lane still takes light
    int begin, end;
    RASTER_FN_MEMBER bool shrink(const Real* transmittance) {
        while (begin < end && !any(transmittance[begin] > splat(0.0f))) begin++;
        while (end > begin && !any(transmittance[end - 1] > splat(0.0f))) end--;
        return begin < end;
    }
};

RASTER_FN Real pixel_centers(int tile_x) {
    Real r;
    for (int i = 0; i < LANES; i++) r[i] = (float)(tile_x * TILE_WIDTH + i) + 0.5f;
    return r;
}

template <class State>
static inline void forward_tile(State& s, int tile) {
    const Splat* splats = reinterpret_cast<const Splat*>(s.splats.data);
    const Camera& c = *reinterpret_cast<const Camera*>(s.camera.data);
    int tile_x = tile % s.tiles_x, top = tile / s.tiles_x * TILE_HEIGHT, left = tile_x * TILE_WIDTH;
    int rows = imin(TILE_HEIGHT, s.height - top), columns = imin(TILE_WIDTH, s.width - left);
    Real transmittance[TILE_HEIGHT], red[TILE_HEIGHT], green[TILE_HEIGHT], blue[TILE_HEIGHT], depth[TILE_HEIGHT];
    Real zero = splat(0.0f), one = splat(1.0f);
    for (int i = columns; i < LANES; i++) one[i] = -1.0f;
    for (int r = 0; r < TILE_HEIGHT; r++) {
        transmittance[r] = one;
        red[r] = green[r] = blue[r] = depth[r] = zero;
    }
    Real px = pixel_centers(tile_x);
    Window window = {0, rows};
    int begin = s.tile_start.data[tile], end = s.tile_start.data[tile + 1];
    for (int k = begin; k < end; k++) {
        if ((k - begin) % GAUSSIANS_BETWEEN_CHECKS == GAUSSIANS_BETWEEN_CHECKS - 1 && !window.shrink(transmittance)) break;
        const Splat& g = splats[s.list_gaussian.data[k]];
        int span = s.list_rows.data[k];
        int first = imax(window.begin, span & 15), last = imin(window.end - 1, span >> 4);
        Real dx = px - g.x, quadratic = dx * dx * g.xx, linear = dx * g.xy;
        Real opacity = splat(g.opacity), cutoff = splat(g.cutoff);
        for (int r = first; r <= last; r++) {
            float dy = (float)(top + r) + 0.5f - g.y;
            Real exponent = quadratic + (linear + g.yy * dy) * dy;
            Real alpha = least(exp2_of(exponent) * opacity, splat(RASTER_ALPHA_MAX));
            Real t = transmittance[r], next = t - t * alpha;
            Mask reached = exponent >= cutoff, blended = reached & (next >= splat(RASTER_TRANSMITTANCE_MIN));
            Real weight = select(blended, alpha * t, zero);
            red[r] += weight * g.color[0];
            green[r] += weight * g.color[1];
            blue[r] += weight * g.color[2];
            depth[r] += weight * g.depth;
            transmittance[r] = select(blended, next, (Real)((Mask)t | (reached & SIGN_BIT)));
        }
    }
    for (int r = 0; r < rows; r++) {
        long long row = (long long)(top + r) * s.width + left;
        for (int i = 0; i < columns; i++) {
            float t = transmittance[r][i];
            t = t < 0.0f ? -t : t;
            s.color.data[3 * (row + i)] = red[r][i] + t * c.background[0];
            s.color.data[3 * (row + i) + 1] = green[r][i] + t * c.background[1];
            s.color.data[3 * (row + i) + 2] = blue[r][i] + t * c.background[2];
            s.depth.data[row + i] = depth[r][i];
            s.alpha.data[row + i] = 1.0f - t;
        }
    }
}

// The gradient is taken front to back too: what lies behind a Gaussian is the total minus what came before.
// DEPTH: also gradients of depth and alpha. ABSOLUTE: also sums of |dL/dx|, |dL/dy|.
template <bool DEPTH, bool ABSOLUTE, class State>
static inline void backward_tile(State& s, int tile) {
    const Splat* splats = reinterpret_cast<const Splat*>(s.splats.data);
    const Camera& c = *reinterpret_cast<const Camera*>(s.camera.data);
    int tile_x = tile % s.tiles_x, top = tile / s.tiles_x * TILE_HEIGHT, left = tile_x * TILE_WIDTH;
    int rows = imin(TILE_HEIGHT, s.height - top), columns = imin(TILE_WIDTH, s.width - left);
    Real transmittance[TILE_HEIGHT], behind[TILE_HEIGHT], red[TILE_HEIGHT], green[TILE_HEIGHT], blue[TILE_HEIGHT];
    Real depth[TILE_HEIGHT], opaque[TILE_HEIGHT];
    Real zero = splat(0.0f), one = splat(1.0f);
    for (int i = columns; i < LANES; i++) one[i] = -1.0f;
    float b0 = c.background[0], b1 = c.background[1], b2 = c.background[2];
    for (int r = 0; r < TILE_HEIGHT; r++) {
        transmittance[r] = one;
        behind[r] = red[r] = green[r] = blue[r] = depth[r] = opaque[r] = zero;
        if (r >= rows) continue;
        long long row = (long long)(top + r) * s.width + left;
        for (int i = 0; i < columns; i++) {
            const float* gradient = s.grad_color.data + 3 * (row + i);
            const float* color = s.color.data + 3 * (row + i);
            red[r][i] = gradient[0];
            green[r][i] = gradient[1];
            blue[r][i] = gradient[2];
            // Colours count relative to the background: a Gaussian's weight is taken from it.
            float total = gradient[0] * (color[0] - b0) + gradient[1] * (color[1] - b1) + gradient[2] * (color[2] - b2);
            if (DEPTH) {
                depth[r][i] = s.grad_depth.data[row + i];
                opaque[r][i] = s.grad_alpha.data[row + i];
                total += depth[r][i] * s.depth.data[row + i] + opaque[r][i] * s.alpha.data[row + i];
            }
            behind[r][i] = total;
        }
    }
    Real px = pixel_centers(tile_x);
    Window window = {0, rows};
    int begin = s.tile_start.data[tile], end = s.tile_start.data[tile + 1], k = begin;
    for (; k < end; k++) {
        if ((k - begin) % GAUSSIANS_BETWEEN_CHECKS == GAUSSIANS_BETWEEN_CHECKS - 1 && !window.shrink(transmittance)) break;
        const Splat& g = splats[s.list_gaussian.data[k]];
        int span = s.list_rows.data[k];
        int first = imax(window.begin, span & 15), last = imin(window.end - 1, span >> 4);
        Real dx = px - g.x, quadratic = dx * dx * g.xx, linear = dx * g.xy;
        Real opacity = splat(g.opacity), cutoff = splat(g.cutoff);
        Real c0 = splat(g.color[0] - b0), c1 = splat(g.color[1] - b1), c2 = splat(g.color[2] - b2);
        Real sum0 = zero, sum1 = zero, sum2 = zero, sum_depth = zero, sum = zero, sum_y = zero, sum_yy = zero;
        Real abs_x = zero, abs_y = zero;
        for (int r = first; r <= last; r++) {
            float dy = (float)(top + r) + 0.5f - g.y;
            Real exponent = quadratic + (linear + g.yy * dy) * dy;
            Real raw = exp2_of(exponent) * opacity, alpha = least(raw, splat(RASTER_ALPHA_MAX));
            Real t = transmittance[r], next = t - t * alpha;
            Mask reached = exponent >= cutoff, blended = reached & (next >= splat(RASTER_TRANSMITTANCE_MIN));
            Real weight = select(blended, alpha * t, zero);
            Real own = red[r] * c0 + green[r] * c1 + blue[r] * c2;
            if (DEPTH) own += depth[r] * g.depth + opaque[r];
            own *= weight;
            Real rest = behind[r] - own;
            behind[r] = rest;
            sum0 += weight * red[r];
            sum1 += weight * green[r];
            sum2 += weight * blue[r];
            if (DEPTH) sum_depth += weight * depth[r];
            Real slope = own - rest * alpha / (1.0f - alpha);  // alpha dL/dalpha
            slope = select(blended & (raw <= splat(RASTER_ALPHA_MAX)), slope, zero);
            sum += slope;
            sum_y += slope * dy;
            sum_yy += slope * (dy * dy);
            if (ABSOLUTE) {
                Real along_x = slope * ((2.0f * g.xx) * dx + g.xy * dy), along_y = slope * (linear + (2.0f * g.yy) * dy);
                abs_x += (Real)((Mask)along_x & 0x7fffffff);
                abs_y += (Real)((Mask)along_y & 0x7fffffff);
            }
            transmittance[r] = select(blended, next, (Real)((Mask)t | (reached & SIGN_BIT)));
        }
        float* out = s.moments.data + (long long)s.list_slot.data[k] * MOMENTS;
        out[0] = raster::sum(sum0);
        out[1] = raster::sum(sum1);
        out[2] = raster::sum(sum2);
        out[3] = DEPTH ? raster::sum(sum_depth) : 0.0f;
        out[4] = raster::sum(sum);
        out[5] = raster::sum(sum * dx);
        out[6] = raster::sum(sum_y);
        out[7] = raster::sum(sum * dx * dx);
        out[8] = raster::sum(sum_y * dx);
        out[9] = raster::sum(sum_yy);
        out[10] = ABSOLUTE ? raster::sum(abs_x) * RASTER_LN_2 : 0.0f;
        out[11] = ABSOLUTE ? raster::sum(abs_y) * RASTER_LN_2 : 0.0f;
    }
    for (; k < end; k++) {
        float* out = s.moments.data + (long long)s.list_slot.data[k] * MOMENTS;
        for (int m = 0; m < MOMENTS; m++) out[m] = 0.0f;
    }
}

// The colours' part alone: sums of weight * gradient.
template <class State>
static inline void backward_tile_colors(State& s, int tile) {
    const Splat* splats = reinterpret_cast<const Splat*>(s.splats.data);
    int tile_x = tile % s.tiles_x, top = tile / s.tiles_x * TILE_HEIGHT, left = tile_x * TILE_WIDTH;
    int rows = imin(TILE_HEIGHT, s.height - top), columns = imin(TILE_WIDTH, s.width - left);
    Real transmittance[TILE_HEIGHT], red[TILE_HEIGHT], green[TILE_HEIGHT], blue[TILE_HEIGHT];
    Real zero = splat(0.0f), one = splat(1.0f);
    for (int i = columns; i < LANES; i++) one[i] = -1.0f;
    for (int r = 0; r < TILE_HEIGHT; r++) {
        transmittance[r] = one;
        red[r] = green[r] = blue[r] = zero;
        if (r >= rows) continue;
        for (int i = 0; i < columns; i++) {
            const float* gradient = s.grad_color.data + 3 * ((long long)(top + r) * s.width + left + i);
            red[r][i] = gradient[0];
            green[r][i] = gradient[1];
            blue[r][i] = gradient[2];
        }
    }
    Real px = pixel_centers(tile_x);
    Window window = {0, rows};
    int begin = s.tile_start.data[tile], end = s.tile_start.data[tile + 1], k = begin;
    for (; k < end; k++) {
        if ((k - begin) % GAUSSIANS_BETWEEN_CHECKS == GAUSSIANS_BETWEEN_CHECKS - 1 && !window.shrink(transmittance)) break;
        const Splat& g = splats[s.list_gaussian.data[k]];
        int span = s.list_rows.data[k];
        int first = imax(window.begin, span & 15), last = imin(window.end - 1, span >> 4);
        Real dx = px - g.x, quadratic = dx * dx * g.xx, linear = dx * g.xy;
        Real opacity = splat(g.opacity), cutoff = splat(g.cutoff), sum0 = zero, sum1 = zero, sum2 = zero;
        for (int r = first; r <= last; r++) {
            float dy = (float)(top + r) + 0.5f - g.y;
            Real exponent = quadratic + (linear + g.yy * dy) * dy;
            Real alpha = least(exp2_of(exponent) * opacity, splat(RASTER_ALPHA_MAX));
            Real t = transmittance[r], next = t - t * alpha;
            Mask reached = exponent >= cutoff, blended = reached & (next >= splat(RASTER_TRANSMITTANCE_MIN));
            Real weight = select(blended, alpha * t, zero);
            sum0 += weight * red[r];
            sum1 += weight * green[r];
            sum2 += weight * blue[r];
            transmittance[r] = select(blended, next, (Real)((Mask)t | (reached & SIGN_BIT)));
        }
        float* out = s.moments.data + (long long)s.list_slot.data[k] * MOMENTS;
        out[0] = raster::sum(sum0);
        out[1] = raster::sum(sum1);
        out[2] = raster::sum(sum2);
        for (int m = 3; m < MOMENTS; m++) out[m] = 0.0f;
    }
    for (; k < end; k++) {
        float* out = s.moments.data + (long long)s.list_slot.data[k] * MOMENTS;
        for (int m = 0; m < MOMENTS; m++) out[m] = 0.0f;
    }
}

template <class State>
RASTER_FN void forward_stage(State& s) {
    for (int tile; (tile = take(s.counters.data + STAGE_FORWARD)) < s.tiles;) forward_tile(s, tile);
}

template <class State>
RASTER_FN void backward_stage(State& s) {
    for (int tile; (tile = take(s.counters.data + STAGE_BACKWARD)) < s.tiles;) {
        if (s.colors_only) backward_tile_colors(s, tile);
        else if (s.with_depth) s.absolute ? backward_tile<true, true>(s, tile) : backward_tile<true, false>(s, tile);
        else s.absolute ? backward_tile<false, true>(s, tile) : backward_tile<false, false>(s, tile);
    }
}

}  // namespace raster
