"use strict";
// Runs in a worker: the order in which Gaussians are blended, the farthest first, by planar depth as in the rasteriser.

function makeSorter(means) {
  const most = means.length / 3;
  const depths = new Float32Array(most), bits = new Uint32Array(depths.buffer);
  const first = new Uint32Array(most), second = new Uint32Array(most);
  const bins = new Uint32Array(65536);

  // One pass of a radix sort by 16 bits. Depths are positive, so their bits have the order of their values.
  function pass(source, target, length, shift) {
    bins.fill(0);
    for (let i = 0; i < length; i++) bins[(bits[source[i]] >>> shift) & 65535]++;
    for (let bin = 65535, start = 0; bin >= 0; bin--) {
      const size = bins[bin];
      bins[bin] = start;
      start += size;
    }
    for (let i = 0; i < length; i++) target[bins[(bits[source[i]] >>> shift) & 65535]++] = source[i];
  }

  // row: of world to camera, four numbers; those nearer than `near` are left out, and all beyond the first `count`.
  return (row, near, count) => {
    let kept = 0;
    for (let i = 0, k = 0; i < count; i++, k += 3) {
      const depth = row[0] * means[k] + row[1] * means[k + 1] + row[2] * means[k + 2] + row[3];
      depths[i] = depth;
      if (depth >= near) first[kept++] = i;
    }
    pass(first, second, kept, 0);
    pass(second, first, kept, 16);
    return first.slice(0, kept);
  };
}

if (typeof WorkerGlobalScope !== "undefined" && self instanceof WorkerGlobalScope) {
  let sort;
  self.onmessage = ({ data }) => {
    if (data.means) sort = makeSorter(data.means);
    else {
      const order = sort(data.row, data.near, data.count);
      self.postMessage({ order, ticket: data.ticket }, [order.buffer]);
    }
  };
}
