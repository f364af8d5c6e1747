// Maps of the network's square at the photo's pixels, with the photo as guide: relight/photos/guide.py. Maps and
// guides are lists of planes, one a channel.

import { extremes, means } from "./filters.js";
import { nearest } from "./regions.js";

const RADIUS = 2; // pixels of the square
const SMOOTH = 1e-3, SMOOTH_ALBEDO = 1e-4; // variance of the guide under which a window is flat: for other maps, for albedo

class Guide {
  constructor(values, mask, size) {
    Object.assign(this, { values, size, weight: Float64Array.from(mask), nearest: nearest(mask, size) });
    this.total = this.sum(this.weight).map((value) => Math.max(value, 1e-12));
    this.average = values.map((plane) => this.mean(plane));
    this.spread = values.map((plane, c) => {
      const square = this.mean(plane.map((value) => value * value));
      return square.map((value, i) => Math.max(value - this.average[c][i] ** 2, 0));
    });
  }

  sum(plane) {
    return means(plane, this.size, 2 * RADIUS + 1);
  }

  // Over the windows, of what lies in the mask.
  mean(plane) {
    const sums = this.sum(this.weight.map((weight, i) => weight * plane[i]));
    return sums.map((value, i) => value / this.total[i]);
  }

  // The slope of a plane on channel `c` of the guide: weighted least squares in windows, averaged over windows.
  slope(plane, c, smooth) {
    const values = this.values[c], average = this.average[c], spread = this.spread[c], level = this.mean(plane);
    const along = this.mean(Float64Array.from(plane, (value, i) => value * values[i]));
    return this.mean(along.map((value, i) => (value - average[i] * level[i]) / (spread[i] + smooth)));
  }

  // A plane with what is nearest inside the mask in place of what is outside.
  fillOutside(plane) {
    return Float32Array.from(this.nearest, (i) => plane[i]);
  }

  // `maps` at the photo's pixels; detail: planes of what the guide has there beyond the square. isTextured: the maps have
  // the photo's own texture, as albedo has, and are held between 0 and 1; others between the values they have near.
  place(crop, maps, detail, isTextured = false) {
    return maps.map((plane, n) => {
      const c = this.values.length > 1 ? n : 0, base = this.fillOutside(plane);
      const fitted = this.slope(plane, c, isTextured ? SMOOTH_ALBEDO : SMOOTH);
      const values = crop.place(base), slope = crop.place(this.fillOutside(fitted), false);
      const [low, high] = isTextured ? [] : extremes(base, this.size, 3).map((bound) => crop.place(bound, false));
      return values.map((value, i) => {
        const found = value + slope[i] * detail[c][i];
        return Math.min(Math.max(found, isTextured ? 0 : low[i]), isTextured ? 1 : high[i]);
      });
    });
  }
}

export { Guide };
