// The stages of a render on CUDA that are not blending; one thread is one Gaussian or one intersection.
#pragma once

namespace raster {

template <class State>
RASTER_FN void project_one(State& s, int n) {
    project(s, n, 1);
    s.order.data[n] = n;
}

struct CountSlots {
    int count;
    RASTER_FN_MEMBER void operator()(int, int, int) { count++; }
};

struct FillSlots {
    int slot, gaussian;
    int* tile;   // per slot; to be sorted by
    int* value;  // per slot; the slot itself, to be carried along
    int* owner;  // per slot
    RASTER_FN_MEMBER void operator()(int tile_index, int, int) {
        tile[slot] = tile_index;
        value[slot] = slot;
        owner[slot] = gaussian;
        slot++;
    }
};

// How many tiles the Gaussian at `rank` of the depth order reaches.
template <class State>
RASTER_FN void count_slots(State& s, int rank) {
    CountSlots count = {0};
    if (rank < s.gaussians)
        for_each_tile(reinterpret_cast<const Splat*>(s.splats.data)[s.order.data[rank]], s.width, s.height, s.tiles_x,
                      count);
    s.slot_count.data[rank] = count.count;
}

template <class State>
RASTER_FN void fill_slots(State& s, int rank) {
    int gaussian = s.order.data[rank];
    FillSlots fill = {s.first_slot.data[rank], gaussian, s.slot_tile.data, s.list_slot.data, s.slot_owner.data};
    for_each_tile(reinterpret_cast<const Splat*>(s.splats.data)[gaussian], s.width, s.height, s.tiles_x, fill);
}

// After the stable sort by tile, entry k of the lists: whose it is, and where the lists of the tiles begin.
template <class State>
RASTER_FN void list_entry(State& s, int k, int count) {
    int tile = s.slot_tile.data[k];
    s.list_gaussian.data[k] = s.slot_owner.data[s.list_slot.data[k]];
    for (int t = k == 0 ? 0 : s.slot_tile.data[k - 1] + 1; t <= tile; t++) s.tile_start.data[t] = k;
    if (k == count - 1)
        for (int t = tile + 1; t <= s.tiles; t++) s.tile_start.data[t] = count;
}

template <class State>
RASTER_FN void gather_one(State& s, int rank) {
    int index[1] = {s.order.data[rank]};
    float moments[MOMENTS] = {};
    for (int slot = s.first_slot.data[rank]; slot < s.first_slot.data[rank + 1]; slot++)
        for (int m = 0; m < MOMENTS; m++) moments[m] += s.moments.data[(size_t)slot * MOMENTS + m];
    if (s.colors_only) color_gradient(s, index[0], moments);
    else project_gradient(s, index, moments, 1);
}

}  // namespace raster
