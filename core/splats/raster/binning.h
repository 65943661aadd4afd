// Which tiles, and which pixel rows of them, an ellipse reaches: exact up to a margin of rounding.
#pragma once

namespace raster {

#define RASTER_SPAN_MARGIN 0.02f  // pixels; covers the rounding of the spans, alpha itself is tested per pixel

struct Range {
    int begin, end;  // half-open
};

// Indices i in [0, size) with low <= i + 0.5 <= high. The bounds are clamped first: they may be huge.
RASTER_FN Range centers_between(float low, float high, int size) {
    float bound = (float)size + 1.0f;
    low = low > -1.0f ? (low < bound ? low : bound) : -1.0f;
    high = high < bound ? (high > -1.0f ? high : -1.0f) : bound;
    Range r = {imax(0, (int)ceilf(low - 0.5f)), imin(size, (int)floorf(high - 0.5f) + 1)};
    return r;
}

// First and last pixel row (as numbers, last < first where there is none) that the ellipse reaches within LANES tile
// columns from `column` on, of which only the pixel columns `within` count.
RASTER_FN void rows_in_columns(const Splat& s, int column, Range within, int height, Real& first, Real& last) {
    Real left = ((float)column + lane_indices()) * (float)TILE_WIDTH;
    Real low = greatest(left, splat((float)within.begin)) + (0.5f - s.x);
    Real high = least(left + (float)TILE_WIDTH, splat((float)within.end)) - (0.5f + s.x);
    float a = -s.xx, b = -s.xy, c = -s.yy, bound = -s.cutoff;  // a dx^2 + b dx dy + c dy^2 <= bound
    float peak = -0.5f * b / a * s.extent_y;                   // dx where dy is largest, over the whole ellipse
    Real at_top = least(greatest(splat(peak), low), high), at_bottom = least(greatest(splat(-peak), low), high);
    float half = 0.5f / c, slope = b * b - 4.0f * a * c, rest = 4.0f * c * bound;
    Real root_top = square_root(greatest(at_top * at_top * slope + rest, splat(0.0f)));
    Real root_bottom = square_root(greatest(at_bottom * at_bottom * slope + rest, splat(0.0f)));
    // Rounding of a thin ellipse must not leave its box.
    Real top = least((root_top - at_top * b) * half, splat(s.extent_y)) + (s.y + RASTER_SPAN_MARGIN);
    Real bottom = greatest((-root_bottom - at_bottom * b) * half, splat(-s.extent_y)) + (s.y - RASTER_SPAN_MARGIN);
    first = ceiling(clamp(bottom - 0.5f, 0.0f, (float)height));
    last = floor_of(clamp(top - 0.5f, -1.0f, (float)(height - 1)));
}

// Calls visit(tile, first row in it, last row in it) for every tile that the Gaussian reaches, column by column.
template <class Visit>
RASTER_FN void for_each_tile(const Splat& s, int width, int height, int tiles_x, Visit& visit) {
    if (s.extent_x < 0.0f) return;
    Range within = centers_between(s.x - s.extent_x - RASTER_SPAN_MARGIN, s.x + s.extent_x + RASTER_SPAN_MARGIN, width);
    int column_end = (within.end + TILE_WIDTH - 1) / TILE_WIDTH;
    for (int column = within.begin / TILE_WIDTH; within.begin < within.end && column < column_end; column += LANES) {
        Real first, last;
        rows_in_columns(s, column, within, height, first, last);
        for (int i = 0; i < LANES && column + i < column_end; i++) {
            int row = (int)lane(first, i), end = (int)lane(last, i) + 1;
            while (row < end) {
                int tile_row = row / TILE_HEIGHT, top = tile_row * TILE_HEIGHT, next = imin(top + TILE_HEIGHT, end);
                visit(tile_row * tiles_x + column + i, row - top, next - 1 - top);
                row = next;
            }
        }
    }
}

struct CountTiles {
    int* histogram;  // per tile
    int count;
    RASTER_FN_MEMBER void operator()(int tile, int, int) {
        histogram[tile]++;
        count++;
    }
};

struct ListTiles {
    int* cursor;  // per tile: where its next entry goes
    int gaussian, slot;
    int* list_gaussian;
    int* list_slot;
    unsigned char* list_rows;
    RASTER_FN_MEMBER void operator()(int tile, int first, int last) {
        int k = cursor[tile]++;
        list_gaussian[k] = gaussian;
        list_slot[k] = slot++;
        list_rows[k] = (unsigned char)(first | last << 4);
    }
};

}  // namespace raster
