// Sets of pixels: connected parts, the nearest pixel of a set. A set is a plane of 0 and 1.

// The flat index of the nearest pixel of `set` for each pixel; of several at the same distance the one that
// scipy.ndimage.distance_transform_edt takes, whose algorithm this is (Maurer, Qi and Raghavan 2003). -1 for an empty set.
function nearest(set, width) {
  const height = set.length / width, rowOf = new Int32Array(set.length).fill(-1), out = new Int32Array(set.length).fill(-1);
  for (let x = 0; x < width; x++) {
    const rows = [];
    for (let y = 0; y < height; y++) if (set[y * width + x]) rows.push(y);
    for (let y = 0, k = 0; rows.length && y < height; y++) {
      while (k + 1 < rows.length && Math.abs(rows[k + 1] - y) < Math.abs(rows[k] - y)) k++;
      rowOf[y * width + x] = rows[k];
    }
  }
  const sites = new Int32Array(width);
  for (let y = 0; y < height; y++) {
    const away = (x) => (rowOf[y * width + x] - y) ** 2;
    let last = -1;
    for (let x = 0; x < width; x++) {
      if (rowOf[y * width + x] < 0) continue;
      for (; last >= 1; last--) { // sites whose cells of the Voronoi diagram do not reach this row
        const a = sites[last] - sites[last - 1], b = x - sites[last], c = a + b;
        if (c * away(sites[last]) - b * away(sites[last - 1]) - a * away(x) - a * b * c <= 0) break;
      }
      sites[++last] = x;
    }
    for (let x = 0, k = 0; last >= 0 && x < width; x++) {
      const distance = (i) => (sites[i] - x) ** 2 + away(sites[i]);
      while (k < last && distance(k + 1) < distance(k)) k++;
      out[y * width + x] = rowOf[y * width + sites[k]] * width + sites[k];
    }
  }
  return out;
}

// Numbers of the connected parts (0 outside of them), and the area of each; `diagonal` steps connect, too, if asked.
function label(set, width, diagonal = false) {
  const labels = new Int32Array(set.length), areas = [0], height = set.length / width, open = [];
  const steps = diagonal ? [-1, 0, 1].flatMap((dy) => [-1, 0, 1].map((dx) => [dx, dy])) : [[-1, 0], [1, 0], [0, -1], [0, 1]];
  for (let start = 0; start < set.length; start++) {
    if (!set[start] || labels[start]) continue;
    const number = areas.push(0) - 1;
    labels[start] = number;
    open.push(start);
    while (open.length) {
      const i = open.pop(), x = i % width, y = Math.floor(i / width);
      areas[number]++;
      for (const [dx, dy] of steps) {
        const j = i + dy * width + dx;
        if (x + dx < 0 || x + dx >= width || y + dy < 0 || y + dy >= height || !set[j] || labels[j]) continue;
        labels[j] = number;
        open.push(j);
      }
    }
  }
  return { labels, areas };
}

// [first, end) of the rows and of the columns that hold pixels of the set; null for an empty one.
function extent(set, width) {
  let [top, bottom, left, right] = [Infinity, -1, Infinity, -1];
  for (let i = 0, x = 0, y = 0; i < set.length; i++, x++) {
    if (x === width) [x, y] = [0, y + 1];
    if (!set[i]) continue;
    if (y < top) top = y;
    bottom = y;
    if (x < left) left = x;
    if (x > right) right = x;
  }
  return bottom < 0 ? null : { rows: [top, bottom + 1], columns: [left, right + 1] };
}

export { extent, label, nearest };
