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

// Pixel rows that the ellipse reaches within the pixel columns [begin, end).
RASTER_FN Range rows_in_columns(const Splat& s, int begin, int end, int height) {
    float low = (float)begin + 0.5f - s.x, high = (float)end - 0.5f - s.x;
    float a = -s.xx, b = -s.xy, c = -s.yy, bound = -s.cutoff;  // a dx^2 + b dx dy + c dy^2 <= bound
    float peak = -0.5f * b / a * s.extent_y;                   // dx where dy is largest, over the whole ellipse
    float at_top = peak < low ? low : (peak > high ? high : peak);
    float at_bottom = -peak < low ? low : (-peak > high ? high : -peak);
    float half = 0.5f / c, slope = b * b - 4.0f * a * c;
    float top = slope * at_top * at_top + 4.0f * c * bound, bottom = slope * at_bottom * at_bottom + 4.0f * c * bound;
    top = (-b * at_top + sqrtf(top > 0.0f ? top : 0.0f)) * half;
    bottom = (-b * at_bottom - sqrtf(bottom > 0.0f ? bottom : 0.0f)) * half;
    // Rounding of a thin ellipse must not leave its box.
    top = top < s.extent_y ? top : s.extent_y;
    bottom = bottom > -s.extent_y ? bottom : -s.extent_y;
    return centers_between(s.y + bottom - RASTER_SPAN_MARGIN, s.y + top + RASTER_SPAN_MARGIN, height);
}

// Calls visit(tile, first row in it, last row in it) for every tile that the Gaussian reaches, column by column.
template <class Visit>
RASTER_FN void for_each_tile(const Splat& s, int width, int height, int tiles_x, Visit& visit) {
    if (s.extent_x < 0.0f) return;
    Range columns = centers_between(s.x - s.extent_x - RASTER_SPAN_MARGIN, s.x + s.extent_x + RASTER_SPAN_MARGIN, width);
    for (int begin = columns.begin; begin < columns.end;) {
        int column = begin / TILE_WIDTH, end = imin((column + 1) * TILE_WIDTH, columns.end);
        Range rows = rows_in_columns(s, begin, end, height);
        for (int row = rows.begin; row < rows.end;) {
            int tile_row = row / TILE_HEIGHT, top = tile_row * TILE_HEIGHT, next = imin(top + TILE_HEIGHT, rows.end);
            visit(tile_row * tiles_x + column, row - top, next - 1 - top);
            row = next;
        }
        begin = end;
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
