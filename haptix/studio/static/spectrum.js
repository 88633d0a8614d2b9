/** Amplitudes of what was felt, by frequency. */

export const POINTS = 512;

/**
 * Return amplitudes of a signal's components, its mean and its ends left out (Hann's window).
 * @param {ArrayLike<number>} signal POINTS long; NaN counts as the mean
 * @returns {Float64Array} POINTS / 2 amplitudes, from 0 Hz on, POINTS-ths of the rate apart
 */
export function amplitudes(signal) {
  let [sum, count] = [0, 0];
  for (let at = 0; at < POINTS; at += 1) {
    if (Number.isNaN(signal[at])) continue;
    sum += signal[at];
    count += 1;
  }
  const mean = sum / Math.max(count, 1);
  const [re, im] = [new Float64Array(POINTS), new Float64Array(POINTS)];
  for (let at = 0; at < POINTS; at += 1) {
    const value = Number.isNaN(signal[at]) ? 0 : signal[at] - mean;
    // In the order of reversed bits, for the transform in place.
    let reversed = 0;
    for (let bit = 1, from = at; bit < POINTS; bit <<= 1, from >>= 1) reversed = (reversed << 1) | (from & 1);
    re[reversed] = value * (0.5 - 0.5 * Math.cos((2 * Math.PI * at) / POINTS));
  }
  for (let half = 1; half < POINTS; half <<= 1) {
    for (let step = 0; step < half; step += 1) {
      const angle = (-Math.PI * step) / half;
      const [c, s] = [Math.cos(angle), Math.sin(angle)];
      for (let at = step; at < POINTS; at += 2 * half) {
        const other = at + half;
        const [x, y] = [re[other] * c - im[other] * s, re[other] * s + im[other] * c];
        re[other] = re[at] - x;
        im[other] = im[at] - y;
        re[at] += x;
        im[at] += y;
      }
    }
  }
  // A sine of amplitude 1 has a component of POINTS / 2, times the window's mean of a half.
  return Float64Array.from({ length: POINTS / 2 }, (_, at) => Math.hypot(re[at], im[at]) / (POINTS / 4));
}
