// Blending of a tile's Gaussians front to back on the CPU, and its gradient: one vector is one row of a tile.
#pragma once

namespace raster {

enum { GAUSSIANS_BETWEEN_CHECKS = 8 };

// The literals of the inner loops. They are read through `volatile` once a tile, so that the compiler keeps them in
// registers and on the stack: in code compiled at run time every literal is an absolute address of its own, and
// computing those took a fifth of the loop.
static volatile const float EXPONENTIAL[] = EXP2_COEFFICIENTS;
static volatile const float LITERALS[] = {EXP2_ROUNDER, RASTER_TRANSMITTANCE_MIN, RASTER_ALPHA_MAX, 1.0f};

struct Literals {
    Real rounder, e5, e4, e3, e2, e1, e0, transmittance_min, alpha_max, one;
    RASTER_FN_MEMBER Literals() {
        e5 = splat(EXPONENTIAL[0]);
        e4 = splat(EXPONENTIAL[1]);
        e3 = splat(EXPONENTIAL[2]);
        e2 = splat(EXPONENTIAL[3]);
        e1 = splat(EXPONENTIAL[4]);
        e0 = splat(EXPONENTIAL[5]);
        rounder = splat(LITERALS[0]);
        transmittance_min = splat(LITERALS[1]);
        alpha_max = splat(LITERALS[2]);
        one = splat(LITERALS[3]);
    }
    // As exp2_of in numeric.h.
    RASTER_FN_MEMBER Real exp2(Real x) const {
        Real shifted = x + rounder;
        Real f = x - (shifted - rounder);
        Real p = ((((e5 * f + e4) * f + e3) * f + e2) * f + e1) * f + e0;
        return (Real)((Mask)p + ((Mask)shifted << 23));
    }
};

// A Gaussian as the rows of a tile see it.
struct Footprint {
    Real dx, quadratic, linear, yy, opacity, cutoff, dy;
    int first, last;  // rows of the tile, inclusive
    bool capped;      // alpha may have to be capped
    RASTER_FN_MEMBER Footprint(const Splat& g, Real pixels, int top, int first_row, int last_row) {
        dx = pixels - g.x;
        quadratic = dx * dx * g.xx;
        linear = dx * g.xy;
        yy = splat(g.yy);
        opacity = splat(g.opacity);
        cutoff = splat(g.cutoff);
        first = first_row;
        last = last_row;
        dy = splat((float)(top + first) + 0.5f - g.y);
        capped = g.opacity > RASTER_ALPHA_MAX;
    }
};

struct Window {  // rows of the tile in which some pixel still takes light
    int begin, end;
    template <class Row>
    RASTER_FN_MEMBER bool shrink(const Row* rows, Real least_transmittance) {
        while (begin < end && !any(rows[begin].transmittance >= least_transmittance)) begin++;
        while (end > begin && !any(rows[end - 1].transmittance >= least_transmittance)) end--;
        return begin < end;
    }
};

// What every pass over a tile's list has in common.
struct TileList {
    int top, left, rows, columns;  // pixels
    int begin, end;                // of the list
    Real pixels;                   // x of the pixel centres
    Real transmittance;            // at the start: 1, and 0 beyond the image
    template <class State>
    RASTER_FN_MEMBER TileList(State& s, int tile) {
        top = tile / s.tiles_x * TILE_HEIGHT;
        left = tile % s.tiles_x * TILE_WIDTH;
        rows = imin(TILE_HEIGHT, s.height - top);
        columns = imin(TILE_WIDTH, s.width - left);
        begin = s.tile_start.data[tile];
        end = s.tile_start.data[tile + 1];
        for (int i = 0; i < LANES; i++) {
            pixels[i] = (float)(left + i) + 0.5f;
            transmittance[i] = i < columns ? 1.0f : 0.0f;
        }
    }
    template <class Row>
    RASTER_FN_MEMBER bool saturated(int k, Window& window, const Row* row, Real least_transmittance) const {
        return (k - begin) % GAUSSIANS_BETWEEN_CHECKS == GAUSSIANS_BETWEEN_CHECKS - 1 &&
               !window.shrink(row, least_transmittance);
    }
};

struct ForwardRow {
    Real transmittance, red, green, blue, depth;
};

template <bool CAPPED>
RASTER_FN void blend_rows(const Literals& l, const Footprint& f, const Splat& g, ForwardRow* rows) {
    Real red = splat(g.color[0]), green = splat(g.color[1]), blue = splat(g.color[2]), depth = splat(g.depth);
    Real dy = f.dy;
    for (ForwardRow *row = rows + f.first, *last = rows + f.last; row <= last; row++, dy += l.one) {
        Real exponent = (f.yy * dy + f.linear) * dy + f.quadratic;
        Real alpha = l.exp2(exponent) * f.opacity;
        if (CAPPED) alpha = least(alpha, l.alpha_max);
        Real t = row->transmittance;
        Mask blended = (exponent >= f.cutoff) & (t >= l.transmittance_min);
        Real weight = (Real)((Mask)(alpha * t) & blended);
        row->transmittance = t - weight;
        row->red += weight * red;
        row->green += weight * green;
        row->blue += weight * blue;
        row->depth += weight * depth;
    }
}

template <class State>
static inline void forward_tile(State& s, int tile) {
    const Splat* splats = reinterpret_cast<const Splat*>(s.splats.data);
    const Camera& c = *reinterpret_cast<const Camera*>(s.camera.data);
    const Literals literals;
    const TileList list(s, tile);
    ForwardRow rows[TILE_HEIGHT];
    Real zero = splat(0.0f);
    for (int r = 0; r < TILE_HEIGHT; r++) rows[r] = ForwardRow{list.transmittance, zero, zero, zero, zero};
    Window window = {0, list.rows};
    for (int k = list.begin; k < list.end; k++) {
        if (list.saturated(k, window, rows, literals.transmittance_min)) break;
        const Splat& g = splats[s.list_gaussian.data[k]];
        int span = s.list_rows.data[k];
        const Footprint f(g, list.pixels, list.top, imax(window.begin, span & 15), imin(window.end - 1, span >> 4));
        if (f.capped) blend_rows<true>(literals, f, g, rows);
        else blend_rows<false>(literals, f, g, rows);
    }
    for (int r = 0; r < list.rows; r++) {
        long long first = (long long)(list.top + r) * s.width + list.left;
        const ForwardRow& row = rows[r];
        Real t = row.transmittance;
        Real red = row.red + t * c.background[0], green = row.green + t * c.background[1],
             blue = row.blue + t * c.background[2];
        for (int i = 0; i < list.columns; i++) {
            s.color.data[3 * (first + i)] = red[i];
            s.color.data[3 * (first + i) + 1] = green[i];
            s.color.data[3 * (first + i) + 2] = blue[i];
            s.depth.data[first + i] = row.depth[i];
            s.alpha.data[first + i] = 1.0f - t[i];
        }
    }
}

struct BackwardRow {
    Real transmittance, behind;            // `behind`: dL/dimage times what is yet to be blended
    Real red, green, blue, depth, opaque;  // dL/dimage
};

struct PixelSums {  // per column, over the rows
    Real red, green, blue, depth, slope, slope_y, slope_yy, abs_x, abs_y;
};

// The gradient is taken front to back too: what lies behind a Gaussian is the total minus what came before.
// DEPTH: also gradients of depth and alpha. ABSOLUTE: also sums of |dL/dx|, |dL/dy|.
template <bool DEPTH, bool ABSOLUTE, bool CAPPED>
RASTER_FN PixelSums gradient_rows(const Literals& l, const Footprint& f, const Splat& g, const float* background,
                                  BackwardRow* rows) {
    // Colours count relative to the background: a Gaussian's weight is taken from it.
    Real red = splat(g.color[0] - background[0]), green = splat(g.color[1] - background[1]),
         blue = splat(g.color[2] - background[2]);
    Real zero = splat(0.0f), dy = f.dy;
    Real two_xx_dx, xy, two_yy;
    if (ABSOLUTE) {
        two_xx_dx = f.dx * (2.0f * g.xx);
        xy = splat(g.xy);
        two_yy = splat(2.0f * g.yy);
    }
    PixelSums sums = {zero, zero, zero, zero, zero, zero, zero, zero, zero};
    for (BackwardRow *row = rows + f.first, *last = rows + f.last; row <= last; row++, dy += l.one) {
        Real exponent = (f.yy * dy + f.linear) * dy + f.quadratic;
        Real alpha = l.exp2(exponent) * f.opacity;
        Mask uncapped;
        if (CAPPED) {
            uncapped = alpha <= l.alpha_max;
            alpha = least(alpha, l.alpha_max);
        }
        Real t = row->transmittance;
        Mask blended = (exponent >= f.cutoff) & (t >= l.transmittance_min);
        Real weight = (Real)((Mask)(alpha * t) & blended);
        row->transmittance = t - weight;
        Real own = row->red * red + row->green * green + row->blue * blue;
        if (DEPTH) own += row->depth * g.depth + row->opaque;
        own *= weight;
        Real behind = row->behind - own;
        row->behind = behind;
        sums.red += weight * row->red;
        sums.green += weight * row->green;
        sums.blue += weight * row->blue;
        if (DEPTH) sums.depth += weight * row->depth;
        Real slope = own - behind * alpha / (l.one - alpha);  // alpha dL/dalpha
        slope = (Real)((Mask)slope & (CAPPED ? blended & uncapped : blended));
        Real slope_y = slope * dy;
        sums.slope += slope;
        sums.slope_y += slope_y;
        sums.slope_yy += slope_y * dy;
        if (ABSOLUTE) {
            Real along_x = slope * (xy * dy + two_xx_dx), along_y = slope * (two_yy * dy + f.linear);
            sums.abs_x += (Real)((Mask)along_x & 0x7fffffff);
            sums.abs_y += (Real)((Mask)along_y & 0x7fffffff);
        }
    }
    return sums;
}

// The sums of eight vectors, as a vector.
RASTER_FN Real sums_of(Real a, Real b, Real c, Real d, Real e, Real f, Real g, Real h) {
#define INTERLEAVED(u, v) \
    (__builtin_shufflevector(u, v, 0, 8, 2, 10, 4, 12, 6, 14) + __builtin_shufflevector(u, v, 1, 9, 3, 11, 5, 13, 7, 15))
#define PAIRED(u, v) \
    (__builtin_shufflevector(u, v, 0, 1, 8, 9, 4, 5, 12, 13) + __builtin_shufflevector(u, v, 2, 3, 10, 11, 6, 7, 14, 15))
    Real low = PAIRED(INTERLEAVED(a, b), INTERLEAVED(c, d)), high = PAIRED(INTERLEAVED(e, f), INTERLEAVED(g, h));
#undef INTERLEAVED
#undef PAIRED
    return __builtin_shufflevector(low, high, 0, 1, 2, 3, 8, 9, 10, 11) +
           __builtin_shufflevector(low, high, 4, 5, 6, 7, 12, 13, 14, 15);
}

template <class State>
RASTER_FN float* moments_of(State& s, int k) {
    return s.moments.data + (long long)s.list_slot.data[k] * MOMENTS;
}

template <class State>
RASTER_FN void clear_moments(State& s, int begin, int end) {
    for (int k = begin; k < end; k++)
        for (int m = 0; m < MOMENTS; m++) moments_of(s, k)[m] = 0.0f;
}

template <bool DEPTH, bool ABSOLUTE, class State>
static inline void backward_tile(State& s, int tile) {
    const Splat* splats = reinterpret_cast<const Splat*>(s.splats.data);
    const Camera& c = *reinterpret_cast<const Camera*>(s.camera.data);
    const Literals literals;
    const TileList list(s, tile);
    BackwardRow rows[TILE_HEIGHT];
    Real zero = splat(0.0f);
    for (int r = 0; r < TILE_HEIGHT; r++) {
        BackwardRow& row = rows[r];
        row = BackwardRow{list.transmittance, zero, zero, zero, zero, zero, zero};
        if (r >= list.rows) continue;
        long long first = (long long)(list.top + r) * s.width + list.left;
        for (int i = 0; i < list.columns; i++) {
            const float* gradient = s.grad_color.data + 3 * (first + i);
            const float* color = s.color.data + 3 * (first + i);
            row.red[i] = gradient[0];
            row.green[i] = gradient[1];
            row.blue[i] = gradient[2];
            float total = 0.0f;
            for (int j = 0; j < 3; j++) total += gradient[j] * (color[j] - c.background[j]);
            if (DEPTH) {
                row.depth[i] = s.grad_depth.data[first + i];
                row.opaque[i] = s.grad_alpha.data[first + i];
                total += row.depth[i] * s.depth.data[first + i] + row.opaque[i] * s.alpha.data[first + i];
            }
            row.behind[i] = total;
        }
    }
    Window window = {0, list.rows};
    int k = list.begin;
    for (; k < list.end; k++) {
        if (list.saturated(k, window, rows, literals.transmittance_min)) break;
        const Splat& g = splats[s.list_gaussian.data[k]];
        int span = s.list_rows.data[k];
        const Footprint f(g, list.pixels, list.top, imax(window.begin, span & 15), imin(window.end - 1, span >> 4));
        const PixelSums p = f.capped ? gradient_rows<DEPTH, ABSOLUTE, true>(literals, f, g, c.background, rows)
                                     : gradient_rows<DEPTH, ABSOLUTE, false>(literals, f, g, c.background, rows);
        Real slope_x = p.slope * f.dx;
        float* out = moments_of(s, k);
        store(out, sums_of(p.red, p.green, p.blue, p.depth, p.slope, slope_x, p.slope_y, slope_x * f.dx));
        Real rest = sums_of(p.slope_y * f.dx, p.slope_yy, p.abs_x * RASTER_LN_2, p.abs_y * RASTER_LN_2, zero, zero,
                            zero, zero);
        for (int m = 0; m < MOMENTS - LANES; m++) out[LANES + m] = rest[m];
    }
    clear_moments(s, k, list.end);
}

struct ColorRow {
    Real transmittance, red, green, blue;
};

template <bool CAPPED>
RASTER_FN PixelSums color_rows(const Literals& l, const Footprint& f, ColorRow* rows) {
    Real zero = splat(0.0f), dy = f.dy;
    PixelSums sums = {zero, zero, zero, zero, zero, zero, zero, zero, zero};
    for (ColorRow *row = rows + f.first, *last = rows + f.last; row <= last; row++, dy += l.one) {
        Real exponent = (f.yy * dy + f.linear) * dy + f.quadratic;
        Real alpha = l.exp2(exponent) * f.opacity;
        if (CAPPED) alpha = least(alpha, l.alpha_max);
        Real t = row->transmittance;
        Mask blended = (exponent >= f.cutoff) & (t >= l.transmittance_min);
        Real weight = (Real)((Mask)(alpha * t) & blended);
        row->transmittance = t - weight;
        sums.red += weight * row->red;
        sums.green += weight * row->green;
        sums.blue += weight * row->blue;
    }
    return sums;
}

// The colours' part alone: sums of weight * gradient.
template <class State>
static inline void backward_tile_colors(State& s, int tile) {
    const Splat* splats = reinterpret_cast<const Splat*>(s.splats.data);
    const Literals literals;
    const TileList list(s, tile);
    ColorRow rows[TILE_HEIGHT];
    Real zero = splat(0.0f);
    for (int r = 0; r < TILE_HEIGHT; r++) {
        rows[r] = ColorRow{list.transmittance, zero, zero, zero};
        if (r >= list.rows) continue;
        for (int i = 0; i < list.columns; i++) {
            const float* gradient = s.grad_color.data + 3 * ((long long)(list.top + r) * s.width + list.left + i);
            rows[r].red[i] = gradient[0];
            rows[r].green[i] = gradient[1];
            rows[r].blue[i] = gradient[2];
        }
    }
    Window window = {0, list.rows};
    int k = list.begin;
    for (; k < list.end; k++) {
        if (list.saturated(k, window, rows, literals.transmittance_min)) break;
        const Splat& g = splats[s.list_gaussian.data[k]];
        int span = s.list_rows.data[k];
        const Footprint f(g, list.pixels, list.top, imax(window.begin, span & 15), imin(window.end - 1, span >> 4));
        const PixelSums p = f.capped ? color_rows<true>(literals, f, rows) : color_rows<false>(literals, f, rows);
        Real sums = sums_of(p.red, p.green, p.blue, zero, zero, zero, zero, zero);
        for (int m = 0; m < 3; m++) moments_of(s, k)[m] = sums[m];
    }
    clear_moments(s, k, list.end);
}

template <class State>
RASTER_FN void forward_stage(State& s) {
    for (int tile; (tile = take(s.counters.data + STAGE_FORWARD)) < s.tiles;) forward_tile(s, tile);
}

template <class State>
RASTER_FN void backward_stage(State& s) {
    for (int tile; (tile = take(s.counters.data + STAGE_BACKWARD)) < s.tiles;) {
        if (s.colors_only) backward_tile_colors(s, tile);
        else if (s.with_depth) backward_tile<true, true>(s, tile);  // rare: not worth a body without ABSOLUTE
        else if (s.absolute) backward_tile<false, true>(s, tile);
        else backward_tile<false, false>(s, tile);
    }
}

}  // namespace raster
