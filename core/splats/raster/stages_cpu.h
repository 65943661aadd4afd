// The stages of a render on the CPU: every function is called by each worker thread and takes its share of the chunks.
#pragma once

namespace raster {

enum Stage {  // as `Stage` in kernels_cpu.py; each has its chunk counter
    STAGE_PROJECT, STAGE_SORT, STAGE_COUNT, STAGE_OFFSETS, STAGE_LIST, STAGE_FORWARD,
    STAGE_LOSS, STAGE_BACKWARD, STAGE_GATHER, STAGE_ADAM, STAGE_OBSERVE, STAGE_PAIRS, STAGE_CONTRAST
};
enum { GAUSSIANS_A_CHUNK = 256 };

template <class State>
RASTER_FN void project_stage(State& s) {
    for (int chunk; (chunk = take(s.counters.data + STAGE_PROJECT)) * GAUSSIANS_A_CHUNK < s.gaussians;) {
        int end = imin((chunk + 1) * GAUSSIANS_A_CHUNK, s.gaussians);
        for (int i = chunk * GAUSSIANS_A_CHUNK; i < end; i += LANES) project(s, i, imin(LANES, end - i));
    }
}

// Stable least-significant-digit radix sort of the depth keys: `order` lists the Gaussians front to back, culled last.
template <class State>
RASTER_FN void sort_stage(State& s) {
    enum { BITS = 11, BUCKETS = 1 << BITS, PASSES = 3 };
    const unsigned* keys = reinterpret_cast<const unsigned*>(s.keys.data);
    int n = s.gaussians;
    int* histogram = s.sort_histogram.data;  // PASSES x BUCKETS
    for (int i = 0; i < PASSES * BUCKETS; i++) histogram[i] = 0;
    for (int i = 0; i < n; i++)
        for (int pass = 0; pass < PASSES; pass++) histogram[pass * BUCKETS + (keys[i] >> pass * BITS & (BUCKETS - 1))]++;
    int *from = s.sort_scratch.data, *to = s.order.data;  // three passes end in `order`
    for (int i = 0; i < n; i++) from[i] = i;
    for (int pass = 0; pass < PASSES; pass++) {
        int* next = histogram + pass * BUCKETS;
        for (int b = 0, sum = 0; b < BUCKETS; b++) {
            int count = next[b];
            next[b] = sum;
            sum += count;
        }
        for (int i = 0; i < n; i++) to[next[keys[from[i]] >> pass * BITS & (BUCKETS - 1)]++] = from[i];
        int* swap = from;
        from = to;
        to = swap;
    }
}

// Segment p of the depth order: how often it enters each tile, and how many tiles each of its Gaussians reaches.
template <class State>
RASTER_FN void count_stage(State& s) {
    const Splat* splats = reinterpret_cast<const Splat*>(s.splats.data);
    for (int p; (p = take(s.counters.data + STAGE_COUNT)) < s.segments;) {
        CountTiles count = {s.tile_histogram.data + (long long)p * s.tiles, 0};
        for (int t = 0; t < s.tiles; t++) count.histogram[t] = 0;
        int end = (int)((long long)s.gaussians * (p + 1) / s.segments);
        for (int rank = (int)((long long)s.gaussians * p / s.segments); rank < end; rank++) {
            count.count = 0;
            for_each_tile(splats[s.order.data[rank]], s.width, s.height, s.tiles_x, count);
            s.first_slot.data[rank] = count.count;
        }
    }
}

// Turns the counts into the start of every tile's list, of every segment's part of it, and of every Gaussian's slots.
template <class State>
RASTER_FN void offsets_stage(State& s) {
    int sum = 0;
    for (int t = 0; t < s.tiles; t++) {
        s.tile_start.data[t] = sum;
        for (int p = 0; p < s.segments; p++) {
            int& h = s.tile_histogram.data[(long long)p * s.tiles + t];
            int count = h;
            h = sum;
            sum += count;
        }
    }
    s.tile_start.data[s.tiles] = sum;
    int slot = 0;
    for (int rank = 0; rank < s.gaussians; rank++) {
        int count = s.first_slot.data[rank];
        s.first_slot.data[rank] = slot;
        slot += count;
    }
    s.first_slot.data[s.gaussians] = slot;
}

template <class State>
RASTER_FN void list_stage(State& s) {
    const Splat* splats = reinterpret_cast<const Splat*>(s.splats.data);
    for (int p; (p = take(s.counters.data + STAGE_LIST)) < s.segments;) {
        ListTiles list = {s.tile_histogram.data + (long long)p * s.tiles, 0, 0,
                          s.list_gaussian.data, s.list_slot.data, s.list_rows.data};
        int end = (int)((long long)s.gaussians * (p + 1) / s.segments);
        for (int rank = (int)((long long)s.gaussians * p / s.segments); rank < end; rank++) {
            list.gaussian = s.order.data[rank];
            list.slot = s.first_slot.data[rank];
            for_each_tile(splats[list.gaussian], s.width, s.height, s.tiles_x, list);
        }
    }
}

// Sums every Gaussian's intersections in the order of its slots and turns them into gradients of the parameters.
template <class State>
RASTER_FN void gather_stage(State& s) {
    for (int chunk; (chunk = take(s.counters.data + STAGE_GATHER)) * GAUSSIANS_A_CHUNK < s.gaussians;) {
        int end = imin((chunk + 1) * GAUSSIANS_A_CHUNK, s.gaussians);
        for (int first = chunk * GAUSSIANS_A_CHUNK; first < end; first += LANES) {
            int count = imin(LANES, end - first), index[LANES];
            Real moments[MOMENTS];
            for (int m = 0; m < MOMENTS; m++) moments[m] = splat(0.0f);
            for (int i = 0; i < LANES; i++) {
                int rank = first + imin(i, count - 1);
                index[i] = s.order.data[rank];
                float total[MOMENTS] = {};
                const float* slot = s.moments.data + (long long)s.first_slot.data[rank] * MOMENTS;
                const float* last = s.moments.data + (long long)s.first_slot.data[rank + 1] * MOMENTS;
                int used = s.colors_only ? 3 : MOMENTS;
                for (; slot < last; slot += MOMENTS)
                    for (int m = 0; m < used; m++) total[m] += slot[m];
                for (int m = 0; m < MOMENTS; m++) moments[m][i] = total[m];
            }
            if (s.colors_only) {
                for (int i = 0; i < count; i++) {
                    float color[3] = {moments[0][i], moments[1][i], moments[2][i]};
                    color_gradient(s, index[i], color);
                }
            } else {
                project_gradient(s, index, moments, count);
            }
        }
    }
}

}  // namespace raster
