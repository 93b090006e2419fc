// A photo as it is drawn: its colours, its depth as 16-bit codes (0: none, else 1 + disparity / step in the lower 15 bits; the highest: other
// photos confirm it); and the exposure of photos.

// Width of a thumbnail.
const THUMBNAIL = 160;

async function loadPhoto(url) {
  const bitmap = new Image();
  await new Promise((resolve, reject) => {
    [bitmap.onload, bitmap.onerror] = [resolve, () => reject(new Error("the photo cannot be read"))];
    bitmap.src = url;
  });
  const drawn = (width) => {
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [width, Math.max(1, Math.round((width * bitmap.height) / bitmap.width))];
    canvas.getContext("2d", { willReadFrequently: true }).drawImage(bitmap, 0, 0, canvas.width, canvas.height);
    return canvas;
  };
  const pixels = drawn(bitmap.width).getContext("2d").getImageData(0, 0, bitmap.width, bitmap.height).data;
  return { bitmap, pixels, thumbnail: drawn(THUMBNAIL) };
}

// The inverse of crates/viewer/src/depth_code.rs.
async function decodeDepth(bytes, width, height) {
  const compressed = new ReadableStream({
    start(controller) {
      controller.enqueue(bytes);
      controller.close();
    },
  });
  const data = new Uint8Array(await new Response(compressed.pipeThrough(new DecompressionStream("deflate"))).arrayBuffer());
  const [count, view] = [width * height, new DataView(data.buffer)];
  const [flags, high] = [8, 8 + Math.ceil(count / 8)];
  if (data.length !== high + 2 * count) throw new Error(`depth of ${data.length} bytes; expected ${high + 2 * count}`);
  const [step, pixel] = [view.getFloat32(0, true), view.getFloat32(4, true)];
  if (!(step > 0 && pixel > 0)) throw new Error("depth without a unit");
  const codes = new Uint16Array(count);
  for (let at = 0, y = 0; y < height; y += 1) {
    for (let x = 0; x < width; x += 1, at += 1) {
      const left = x > 0 ? codes[at - 1] : 0;
      const above = y > 0 ? codes[at - width] : 0;
      const corner = x > 0 && y > 0 ? codes[at - width - 1] : 0;
      const sum = left + above - corner;
      const low = left < above ? left : above;
      const top = left < above ? above : left;
      const code = (data[high + at] << 8) | data[high + count + at];
      codes[at] = (sum < low ? low : sum > top ? top : sum) + ((code >> 1) ^ -(code & 1));
    }
  }
  for (let at = 0; at < count; at += 1) {
    if ((data[flags + (at >> 3)] >> (at & 7)) & 1) codes[at] |= 0x8000;
    else codes[at] &= 0x7fff;
  }
  return { codes, width, height, step, pixel };
}

// The disparity at a position, 1/scene unit, and whether it is confirmed; undefined where there is none.
function depthAt({ codes, width, height, step }, x, y) {
  if (!(x >= 0 && y >= 0 && x < width && y < height)) return undefined;
  const code = codes[Math.floor(y) * width + Math.floor(x)];
  return (code & 0x7fff) > 0 ? { disparity: ((code & 0x7fff) - 1) * step, isSure: code >= 0x8000 } : undefined;
}

// Pixels (x, y) of photo `a` with the positions (u, v) at which photo `b` shows the same point: every eighth of every eighth row, where both depths are
// confirmed and agree within two pixels of parallax.
function correspondences(a, b) {
  const [onto, found] = [sweep(b.camera, a.camera), []];
  for (let y = 0; y < a.depth.height; y += 8) {
    for (let x = 0; x < a.depth.width; x += 8) {
      const here = depthAt(a.depth, x, y);
      if (!here?.isSure) continue;
      const [u, v, disparity, w] = swept(onto, x + 0.5, y + 0.5, here.disparity);
      const there = w > 0 ? depthAt(b.depth, u, v) : undefined;
      if (there?.isSure && Math.abs(there.disparity - disparity) < 2 * a.depth.pixel) found.push([x, y, u, v]);
    }
  }
  return found;
}

// Factors of the channels that give photo `a` the exposure of photo `b`: medians over their correspondences; 1 where there are fewer than 100.
function relativeGains(a, b) {
  const ratios = [[], [], []];
  const index = (photo, x, y) => 4 * (Math.floor(y) * photo.bitmap.width + Math.floor(x));
  for (const [x, y, u, v] of correspondences(a, b)) {
    const [i, j] = [index(a, x, y), index(b, u, v)];
    for (let c = 0; c < 3; c += 1) {
      const [own, other] = [a.pixels[i + c], b.pixels[j + c]];
      if (own >= 13 && own <= 242 && other >= 13 && other <= 242) ratios[c].push(other / own);
    }
  }
  return ratios.every((all) => all.length >= 100) ? ratios.map(median) : [1, 1, 1];
}

// How much of its detail (4 times a pixel less its four neighbours) a photo lacks beside others that show the same points, by least squares: 0 to 0.15
// (crates/surface/src/correction.rs).
function sharpness(photo, others) {
  let [product, square, count] = [0, 0, 0];
  const [{ width, height }, { pixels }] = [photo.bitmap, photo];
  for (const other of others) {
    const gains = relativeGains(other, photo);
    for (const [x, y, u, v] of correspondences(other, photo)) {
      const [column, row] = [Math.floor(u - 0.5), Math.floor(v - 0.5)];
      if (column < 1 || row < 1 || column >= width - 2 || row >= height - 2) continue;
      count += 1;
      const [across, down] = [u - 0.5 - column, v - 0.5 - row];
      for (let c = 0; c < 3; c += 1) {
        const at = (i, j) => pixels[4 * ((row + j) * width + column + i) + c];
        const between = (i, j) => (at(i, j) * (1 - across) + at(i + 1, j) * across) * (1 - down) + (at(i, j + 1) * (1 - across) + at(i + 1, j + 1) * across) * down;
        const sample = between(0, 0);
        const missing = other.pixels[4 * (y * other.bitmap.width + x) + c] * gains[c] - sample;
        if (Math.abs(missing) >= 25.5) continue;
        const detail = 4 * sample - between(-1, 0) - between(1, 0) - between(0, -1) - between(0, 1);
        product += detail * missing;
        square += detail * detail;
      }
    }
  }
  return count >= 100 && square > 0 ? clamp(product / square, 0, 0.15) : 0;
}

// The same, computed once.
function relativeTo(photo, other) {
  if (!photo.gains.has(other)) photo.gains.set(other, relativeGains(photo, other));
  return photo.gains.get(other);
}

// Gains of photos at these distances from the target: of the exposure between theirs, by 1/distance.
function exposureGains(photos, distances) {
  const [first] = photos;
  const gains = photos.map((photo) => (photo === first || !photo.depth || !first.depth ? [1, 1, 1] : relativeTo(photo, first)));
  const weights = distances.map((d) => 1 / Math.max(d, 1e-9 * Math.max(...distances), 1e-300));
  const total = weights.reduce((sum, weight) => sum + weight, 0);
  const mean = [0, 1, 2].map((c) => Math.exp(gains.reduce((sum, gain, i) => sum + (weights[i] / total) * Math.log(gain[c]), 0)));
  return gains.map((gain) => gain.map((value, c) => value / mean[c]));
}
