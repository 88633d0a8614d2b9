/** Experiments that the page knows; the recipes are those of `haptix stimuli run`. */

/** @typedef {Record<string, any>} Recipe */

const LEVELS = [-30, -27, -24, -21, -18, -15, -12, -9, -6, -3, 0];

/** A ripple of friction that starts and ends softly, on a constant friction.
 * @param {number} frequency_hz @returns {Recipe} */
function ripple(frequency_hz) {
  return {
    quantity: "contrast",
    carrier_hz: 4000,
    signal: {
      kind: "window", rise_s: 0.1, fall_s: 0.1,
      of: { kind: "sine", amplitude: 0.1, frequency_hz, length_s: 1 },
    },
  };
}

const PEDESTAL = { kind: "window", rise_s: 0.1, fall_s: 0.1, of: { kind: "constant", value: 0.13, length_s: 1 } };

/** Recipes by name. @type {Record<string, Recipe>} */
export const EXPERIMENTS = Object.fromEntries([20, 60].map((frequency_hz) => [
  `ripple-${frequency_hz}-Hz`,
  {
    name: `ripple-${frequency_hz}-Hz`,
    task: "2ifc",
    stimulus: ripple(frequency_hz),
    pedestal: PEDESTAL,
    method: { kind: "quest+", levels: LEVELS, threshold: LEVELS, slope: [2, 3.5, 5], trials: 30 },
  },
]));

const RIPPLE_60 = EXPERIMENTS["ripple-60-Hz"];
EXPERIMENTS["strength-60-Hz"] = {
  ...RIPPLE_60, name: "strength-60-Hz", task: "magnitude",
  method: { kind: "magnitudes", levels: [-18, -12, -6, 0], repeats: 4 },
};
EXPERIMENTS["stronger-60-Hz"] = {
  ...RIPPLE_60, name: "stronger-60-Hz", task: "pairs",
  method: { kind: "pairs", levels: [-18, -12, -6, 0], repeats: 3 },
};
EXPERIMENTS["there-60-Hz"] = {
  ...RIPPLE_60, name: "there-60-Hz", task: "yes-no", catch: { share: 0.5 }, break_every: 30,
  method: { kind: "constant-stimuli", levels: [-24, -18, -12, -6], repeats: 8 },
};

/** The same stimulus at its strongest, a few times. @param {Recipe} recipe @returns {Recipe} */
export function practiceOf(recipe) {
  if (["pairs", "magnitudes"].includes(recipe.method.kind)) {
    return { ...recipe, name: `${recipe.name}-practice`, method: { ...recipe.method, repeats: 1 } };
  }
  const strongest = Math.max(...(recipe.method.levels ?? [0]));
  return {
    ...recipe, name: `${recipe.name}-practice`,
    method: { kind: "constant-stimuli", levels: [strongest - 3, strongest], repeats: 2 },
  };
}
