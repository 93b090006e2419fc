// The cells of a photo's depth: squares of 1, 2, 4 … pixels on each of which the disparity is a plane, as large as the depth allows. At edges of
// depth they are single pixels, and nothing connects them. Of each: left, top, side (pixels), whether most of it is confirmed (1 or 0), the
// disparity in its middle, and its slopes to the right and down, per pixel.

const CELL_FLOATS = 7;
const LARGEST_CELL = 5; // as a power of 2
// How far the disparity of a pixel may be from the plane, pixels of parallax: where it is confirmed, and where it is not.
const TOLERANCE = { sure: 0.2, unsure: 1.5 };

// `coarse`: of each 2×2 pixels the nearest confirmed one, else the nearest; sizes are in pixels of the photo all the same.
function cellsOf(depth, coarse) {
  const { codes, width, height } = coarse ? halved(depth) : depth;
  const size = coarse ? 2 : 1;
  const [sure, unsure] = [TOLERANCE.sure, TOLERANCE.unsure].map((pixels) => ((coarse ? 2 : 1) * pixels * depth.pixel) / depth.step);
  const levels = [{ across: width, down: height, is: codes.map((code) => ((code & 0x7fff) > 0 ? 1 : 0)) }];
  for (let level = 1; level <= LARGEST_CELL; level += 1) {
    const [below, side] = [levels[level - 1], 1 << level];
    const [across, down] = [width >> level, height >> level];
    const [is, planes] = [new Uint8Array(across * down), new Float32Array(4 * across * down)];
    // Σ x² over a row of a cell, x from its middle.
    let squares = 0;
    for (let i = 0; i < side; i += 1) squares += (i + 0.5 - side / 2) ** 2;
    for (let row = 0; row < down; row += 1) {
      for (let column = 0; column < across; column += 1) {
        const child = 2 * row * below.across + 2 * column;
        if (!(below.is[child] && below.is[child + 1] && below.is[child + below.across] && below.is[child + below.across + 1])) continue;
        const plane = planeOf(codes, width, row * side * width + column * side, side, squares);
        if (!fits(codes, width, row * side * width + column * side, side, plane, sure, unsure)) continue;
        const at = row * across + column;
        is[at] = 1;
        planes.set(plane, 4 * at);
      }
    }
    levels.push({ across, down, is, planes });
  }
  const cells = [];
  for (let level = LARGEST_CELL; level >= 0; level -= 1) {
    const [{ across, down, is, planes }, above] = [levels[level], levels[level + 1]];
    for (let row = 0, at = 0; row < down; row += 1) {
      for (let column = 0; column < across; column += 1, at += 1) {
        const parent = above && row >> 1 < above.down && column >> 1 < above.across && above.is[(row >> 1) * above.across + (column >> 1)];
        if (!is[at] || parent) continue;
        const side = size << level;
        if (level === 0) cells.push(column * side, row * side, side, codes[at] >> 15, ((codes[at] & 0x7fff) - 1) * depth.step, 0, 0);
        else {
          const [confirmed, mean, slopeX, slopeY] = planes.subarray(4 * at, 4 * at + 4);
          cells.push(column * side, row * side, side, confirmed, (mean - 1) * depth.step, (slopeX * depth.step) / size, (slopeY * depth.step) / size);
        }
      }
    }
  }
  return new Float32Array(cells);
}

// The plane through a cell: whether most of it is confirmed, mean, and slopes, by least squares.
function planeOf(codes, width, first, side, squares) {
  let [sum, slopeX, slopeY, confirmed] = [0, 0, 0, 0];
  for (let y = 0; y < side; y += 1) {
    for (let x = 0; x < side; x += 1) {
      const code = codes[first + y * width + x];
      const value = code & 0x7fff;
      sum += value;
      slopeX += value * (x + 0.5 - side / 2);
      slopeY += value * (y + 0.5 - side / 2);
      confirmed += code >> 15;
    }
  }
  return [2 * confirmed >= side * side ? 1 : 0, sum / (side * side), slopeX / (squares * side), slopeY / (squares * side)];
}

function fits(codes, width, first, side, [, mean, slopeX, slopeY], sure, unsure) {
  for (let y = 0; y < side; y += 1) {
    for (let x = 0; x < side; x += 1) {
      const code = codes[first + y * width + x];
      const error = Math.abs((code & 0x7fff) - mean - slopeX * (x + 0.5 - side / 2) - slopeY * (y + 0.5 - side / 2));
      if (error > (code >= 0x8000 ? sure : unsure)) return false;
    }
  }
  return true;
}

function halved({ codes, width, height }) {
  const [w, h] = [width >> 1, height >> 1];
  const half = new Uint16Array(w * h);
  for (let y = 0; y < h; y += 1) {
    for (let x = 0; x < w; x += 1) {
      const at = 2 * y * width + 2 * x;
      half[y * w + x] = Math.max(codes[at], codes[at + 1], codes[at + width], codes[at + width + 1]);
    }
  }
  return { codes: half, width: w, height: h };
}
