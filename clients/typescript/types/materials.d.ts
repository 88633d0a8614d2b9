/* Made by `make clients` from the schema of the messages; do not edit. */

export type Material =
  | Button
  | ByForce
  | BySpeed
  | Dial
  | WebEffect
  | Envelope
  | Grating
  | Heights
  | LayoutMaterial
  | Moving
  | Noise
  | Penn
  | Photograph
  | Recording
  | Relief
  | Slider
  | Spectral
  | Toggle
  | Transient;
export type Signal =
  | AlongPath
  | Chirp
  | Concatenation
  | Constant
  | Excerpt
  | MaterialSignal
  | Morph
  | Points
  | Product
  | Pulse
  | Ramp
  | Recorded
  | Repetition
  | Sine
  | Square
  | Step
  | Sum
  | TimeNoise
  | Window;

/** A button whose corner is the origin. */
export interface Button {
  kind: "button";
  /** Quantity of `low` and `high`: shares of the reach of the screen, friction coefficients, or relative changes of friction; see `haptix.feel.as_mu`. */
  target?: "share" | "mu" | "contrast";
  /** Friction at the lowest and at the highest level. */
  low?: number;
  /** Friction at the lowest and at the highest level. */
  high?: number;
  /** Size on the screen. What is left at its default is that of the region. */
  width_mm?: number;
  /** Size on the screen. What is left at its default is that of the region. */
  height_mm?: number;
  /** Normal forces at which it is pressed and let go. */
  press_n?: number;
  /** Normal forces at which it is pressed and let go. */
  release_n?: number;
  /** Width of the rim, by which a sliding finger finds the button. */
  rim_mm?: number;
  schema_version?: 1;
}
/** Friction that depends on the normal force, measured or assumed. */
export interface ByForce {
  kind: "by-force";
  /** At the corners: shares of the reachable range; with `of`, factors. */
  share?: number[] | null;
  /** Friction coefficients instead. */
  mu?: number[] | null;
  /** Material that the curve multiplies. */
  of?: Material | null;
  /** Corners of the curve [N]. */
  normal_force_n: number[];
  schema_version?: 1;
}
/** Friction that depends on the finger's speed: a surface that drags more, or slips, the faster. */
export interface BySpeed {
  kind: "by-speed";
  /** At the corners: shares of the reachable range; with `of`, factors. */
  share?: number[] | null;
  /** Friction coefficients instead. */
  mu?: number[] | null;
  /** Material that the curve multiplies. */
  of?: Material | null;
  /** Corners of the curve [mm/s]. */
  speed_mm_s: number[];
  schema_version?: 1;
}
/** A knob: ridges across the way round, as wide at every radius. */
export interface Dial {
  kind: "dial";
  /** Quantity of `low` and `high`: shares of the reach of the screen, friction coefficients, or relative changes of friction; see `haptix.feel.as_mu`. */
  target?: "share" | "mu" | "contrast";
  /** Friction at the lowest and at the highest level. */
  low?: number;
  /** Friction at the lowest and at the highest level. */
  high?: number;
  /** Width of a ridge. It lies between two detents: friction brakes there, and lets go when the finger has passed. It never pulls the finger anywhere, as a spring would. */
  ridge_mm?: number;
  /** In a turn; the first is at 0 deg, to the right, the next ones from x towards y. */
  detents?: number;
  /** Radii between which there are ridges. */
  inner_mm?: number;
  /** Radii between which there are ridges. */
  outer_mm?: number;
  /** Its middle; in a region, from the region's corner. */
  centre_mm?: number[];
  schema_version?: 1;
}
/** One of the web's effects, with an intensity. */
export interface WebEffect {
  kind: "effect";
  /** The event with which it begins. */
  begins?: "start" | "down" | "press" | "release" | "detent";
  /** Which one. */
  name: "hint" | "edge" | "tick" | "align" | "success" | "error";
  /** How strong, 0 to 1. */
  intensity?: number;
  schema_version?: 1;
}
/** Another material times a curve in time. */
export interface Envelope {
  kind: "envelope";
  /** Material that the curve multiplies. */
  of: Material;
  /** Factors against time; before and after, those of its ends. */
  curve: Signal | number;
  /** Whether it begins again at its end. */
  loop?: boolean;
  /** From when its time counts. */
  begins?: "start" | "down" | "press" | "release" | "detent";
  schema_version?: 1;
}
/** Values of a texture where the finger is: on the line y = 0, with all detail. */
export interface AlongPath {
  kind: "along-path";
  field: unknown;
  /** How the finger moves; a number is a steady speed [mm/s]. */
  speed?: {
    [k: string]: unknown;
  };
  length_s?: number | "forever";
  schema_version?: 1;
}
/** A sine whose frequency goes from `start_hz` to `end_hz`, linearly or by equal ratios. */
export interface Chirp {
  kind: "chirp";
  /** Amplitude of the sine, and the value about which it swings. */
  amplitude: number;
  /** First and last frequency [Hz]. */
  start_hz: number;
  /** First and last frequency [Hz]. */
  end_hz: number;
  length_s: number;
  /** "linear", or "logarithmic" for equal ratios in equal times. */
  law?: "linear" | "logarithmic";
  /** Phase at the start [rad]. */
  phase_rad?: number;
  /** Amplitude of the sine, and the value about which it swings. */
  offset?: number;
  schema_version?: 1;
}
/** Signals one after the other. */
export interface Concatenation {
  kind: "concatenation";
  parts: (Signal | number)[];
  schema_version?: 1;
}
/** A constant value. */
export interface Constant {
  kind: "constant";
  /** The value. */
  value: number;
  /** Length [s]; endless if not given. */
  length_s?: number | "forever";
  schema_version?: 1;
}
/** The first `length_s` of a signal; 0 where it has ended before. */
export interface Excerpt {
  kind: "excerpt";
  of: Signal | number;
  length_s: number;
  schema_version?: 1;
}
/** A material's target under the finger, along x at a height `y_mm`, with all detail. */
export interface MaterialSignal {
  kind: "material";
  /** Or its table, or the path of its file. */
  of: Material;
  /** How the finger moves; a number is a steady speed [mm/s]. */
  speed?: {
    [k: string]: unknown;
  };
  /** Where. */
  y_mm?: number;
  /** Normal force [N]; in a stimulus, that of the stimulus. */
  normal_force_n?: number;
  /** Length. */
  length_s?: number | "forever";
  schema_version?: 1;
}
/** A mixture of two finite signals of one length. */
export interface Morph {
  kind: "morph";
  /** At shares of 0 and 1. */
  start: Signal | number;
  /** At shares of 0 and 1. */
  end: Signal | number;
  /** 0 to 1. */
  share: number;
  schema_version?: 1;
}
/** Straight lines between corners; the last corner is the end. */
export interface Points {
  kind: "points";
  /** Times of the corners [s], increasing. */
  t_s: number[];
  /** Values at them. */
  values_at: number[];
  schema_version?: 1;
}
/** Signals multiplied; as long as the shortest. */
export interface Product {
  kind: "product";
  parts: (Signal | number)[];
  schema_version?: 1;
}
/** `height` for `width_s` from `at_s` on, `rest` before and after. */
export interface Pulse {
  kind: "pulse";
  /** Value within the pulse, and outside. */
  height: number;
  /** Its width [s]. */
  width_s: number;
  /** When it begins [s]. */
  at_s?: number;
  /** Value within the pulse, and outside. */
  rest?: number;
  /** Length of the signal [s]; endless if not given. */
  length_s?: number | "forever";
  schema_version?: 1;
}
/** A straight line from `start` at 0 to `end` at the length. */
export interface Ramp {
  kind: "ramp";
  /** First and last value. */
  start: number;
  /** First and last value. */
  end: number;
  length_s: number;
  schema_version?: 1;
}
/** A recorded signal, once; resampled where rates differ. */
export interface Recorded {
  kind: "recorded";
  /** WAV or FLAC file of one channel. */
  file: string;
  /** ``offset + gain * sample``, samples being within -1 and 1. */
  gain?: number;
  /** ``offset + gain * sample``, samples being within -1 and 1. */
  offset?: number;
  sha256?: string;
  schema_version?: 1;
}
/** A finite signal repeated; `times` may be infinite. */
export interface Repetition {
  kind: "repetition";
  of: Signal | number;
  /** How often; endless if not given. */
  times?: number | "forever";
  schema_version?: 1;
}
/** ``offset + amplitude * sin(2 pi f t + phase)``. */
export interface Sine {
  kind: "sine";
  /** Amplitude, and the value about which it swings. */
  amplitude: number;
  frequency_hz: number;
  /** Phase at the start [rad]. */
  phase_rad?: number;
  /** Amplitude, and the value about which it swings. */
  offset?: number;
  /** Length [s]; endless if not given. */
  length_s?: number | "forever";
  schema_version?: 1;
}
/** ``offset + amplitude`` for the first `duty` of a period, ``offset - amplitude`` then. */
export interface Square {
  kind: "square";
  /** Amplitude, and the value about which it swings. */
  amplitude: number;
  frequency_hz: number;
  /** Share of a period with the higher value, between 0 and 1. */
  duty?: number;
  /** Amplitude, and the value about which it swings. */
  offset?: number;
  /** Length [s]; endless if not given. */
  length_s?: number | "forever";
  schema_version?: 1;
}
/** `before` until `at_s`, `after` from there on. */
export interface Step {
  kind: "step";
  /** Value before the step, and from it on. */
  before: number;
  /** Value before the step, and from it on. */
  after: number;
  /** When it steps [s]. */
  at_s: number;
  /** Length of the signal [s]; endless if not given. */
  length_s?: number | "forever";
  schema_version?: 1;
}
/** Signals added; as long as the longest. A signal that has ended adds 0. */
export interface Sum {
  kind: "sum";
  parts: (Signal | number)[];
  schema_version?: 1;
}
/** Gaussian noise of a given deviation and shape of spectrum. */
export interface TimeNoise {
  kind: "time-noise";
  /** Standard deviation. */
  deviation: number;
  /** Corners of the spectrum [Hz], increasing; no power outside. */
  frequency_hz: number[];
  /** Same seed, same noise. */
  seed: number;
  /** Relative power per hertz at the corners, linear in between; by default a flat band. */
  density?: number[];
  /** Mean value. */
  mean?: number;
  /** Length [s]. */
  length_s?: number | "forever";
  /** Power falls as ``1/f`` to this: 1 is pink, 2 brown noise; within the corners, which begin above 0 Hz then. */
  exponent?: number;
  schema_version?: 1;
}
/** A finite signal faded in from `rest` and out to it. */
export interface Window {
  kind: "window";
  of: Signal | number;
  /** Times of the fades in and out [s]. */
  rise_s: number;
  /** Times of the fades in and out [s]. */
  fall_s: number;
  /** "raised-cosine" or "linear". */
  shape?: "raised-cosine" | "linear";
  /** Value before and after. */
  rest?: number;
  schema_version?: 1;
}
/** A periodic wave of friction without end. */
export interface Grating {
  kind: "grating";
  /** Quantity of `low` and `high`: shares of the reach of the screen, friction coefficients, or relative changes of friction; see `haptix.feel.as_mu`. */
  target?: "share" | "mu" | "contrast";
  /** Friction at the lowest and at the highest level. */
  low?: number;
  /** Friction at the lowest and at the highest level. */
  high?: number;
  /** Distance from one rib to the next. */
  period_mm: number;
  /** Shape of the ribs. The square wave is high first. The sawtooth rises and falls at once. */
  wave?: "sine" | "square" | "sawtooth";
  /** Direction in which it runs: 0 to the right, 90 down. Its ridges lie across. */
  orientation_deg?: number;
  /** Part of the period for which the square wave is high. */
  duty?: number;
  /** Part of the period that lies before the origin. The sine is at its middle and rises there. */
  phase?: number;
  schema_version?: 1;
}
/** A height map, felt by one rule; `relief` is right in every direction. */
export interface Heights {
  kind: "heights";
  /** Quantity of `low` and `high`: shares of the reach of the screen, friction coefficients, or relative changes of friction; see `haptix.feel.as_mu`. */
  target?: "share" | "mu" | "contrast";
  /** Friction at the lowest and at the highest level. */
  low?: number;
  /** Friction at the lowest and at the highest level. */
  high?: number;
  /** Picture of the heights, bright is high. */
  file: string;
  /** Width on the screen; the height follows from the pixels. */
  width_mm: number;
  /** What makes friction. */
  rule?: "height" | "slope-magnitude" | "slope-along";
  /** Direction of the stroke for "slope-along": 0 to the right, 90 down. */
  direction_deg?: number;
  schema_version?: 1;
}
/** Materials of every kind in regions; see `haptix.Layout`, which its evaluator is. */
export interface LayoutMaterial {
  kind: "layout";
  /** Each a `haptix.feel.Region`; with a ``name`` it is found by `region`. */
  regions?: Region[];
  /** Friction below all regions. */
  background?: number | Material;
  /** Quantity of the answers. */
  target?: "share" | "mu" | "contrast";
  schema_version?: 1;
}
/**
 * A material in a region of a layout.
 *
 * Parameters
 * ----------
 * name : str, optional
 *     By which `LayoutMaterial.region` finds it.
 * material : FrictionField or Material
 *     Material; its origin lies at the region's corner.
 * mask : FrictionField or Material, optional
 *     Opacity at every place of the region, as a share.
 *
 * Raises
 * ------
 * InputError
 *     If a value is outside its range.
 */
export interface Region {
  x_mm?: number | null;
  y_mm?: number | null;
  rotation_deg?: number | null;
  width_mm?: number | null;
  height_mm?: number | null;
  shape?: ("rectangle" | "ellipse") | number[][] | null;
  scale?: number | null;
  z?: number | null;
  blend?: ("over" | "add" | "multiply" | "max" | "min") | null;
  opacity?: number | null;
  priority?: number | null;
  group?: string | null;
  name?: string | null;
  material: Material;
  mask?: Material | null;
}
/** Another material that moves over the screen; time counts from the first sample. */
export interface Moving {
  kind: "moving";
  /** What moves. */
  of: Material;
  /** Velocity along x and y. */
  velocity_mm_s?: number[];
  /** How fast it turns, from x towards y, about `about_mm`. */
  turn_deg_s?: number;
  /** The place in the material about which it turns. */
  about_mm?: number[];
  /** Places against time, added to the velocity's. */
  path?: PathTable | null;
  schema_version?: 1;
}
/**
 * Places against time, straight lines between them; beyond its ends it stays, or begins again.
 *
 * Parameters
 * ----------
 * t_s : list of float
 *     Times [s], increasing from 0.
 * x_mm, y_mm : list of float
 *     How far the material has moved.
 * angle_deg : list of float, optional
 *     How far it has turned, from x towards y.
 * loop : bool
 *     Whether the path begins again at its end.
 *
 * Examples
 * --------
 * >>> PathTable(t_s=[0.0, 1.0], x_mm=[0.0, 50.0], y_mm=[0.0, 0.0]).loop
 * False
 */
export interface PathTable {
  t_s: number[];
  x_mm: number[];
  y_mm: number[];
  angle_deg?: number[] | null;
  loop?: boolean;
}
/** Gaussian noise on a tile that repeats without a seam. */
export interface Noise {
  kind: "noise";
  /** Mean of the friction, and how far it strays from it. */
  mean?: number;
  /** Mean of the friction, and how far it strays from it. */
  deviation?: number;
  /** Quantity of these: shares of the reach of the screen, friction coefficients, or relative changes of friction. */
  target?: "share" | "mu" | "contrast";
  /** Same seed, same noise. */
  seed?: number;
  /** Side of the tile. */
  tile_mm?: number;
  /** Pixels along it, a power of two. */
  pixels?: number;
  /** Noise over the plane, or along one direction. */
  grain?: "isotropic" | "ribbed";
  /** Direction of the ribbed grain: 0 to the right, 90 down. */
  orientation_deg?: number;
  /** The power falls with the wavenumber to this power: 0 is white. */
  exponent?: number;
  /** Sizes of the smallest and of the largest unevenness: there is power between them. */
  shortest_mm?: number;
  /** Sizes of the smallest and of the largest unevenness: there is power between them. */
  longest_mm?: number;
  schema_version?: 1;
}
/** A model of the Penn Haptic Texture Toolkit at one speed and force. */
export interface Penn {
  kind: "penn";
  /** XML of the model. */
  file: string;
  /** Where the pattern has the model's spectrum. */
  speed_mm_per_s?: number;
  /** Where the pattern has the model's spectrum. */
  normal_force_n?: number;
  /** Turns accelerations into forces; an assumption. */
  mass_kg?: number;
  /** Same seed, same pattern. */
  seed?: number;
  /** Direction of the stroke. */
  orientation_deg?: number;
  schema_version?: 1;
}
/** A photograph, whose grey from the 1st to the 99th percentile becomes friction. */
export interface Photograph {
  kind: "photograph";
  /** Quantity of `low` and `high`: shares of the reach of the screen, friction coefficients, or relative changes of friction; see `haptix.feel.as_mu`. */
  target?: "share" | "mu" | "contrast";
  /** Friction at the lowest and at the highest level. */
  low?: number;
  /** Friction at the lowest and at the highest level. */
  high?: number;
  /** The photograph: PNG, JPEG or TIFF. */
  file: string;
  /** Width on the screen; the height follows from the pixels. */
  width_mm: number;
  /** Which end of the grey scale has the higher friction. */
  polarity?: "bright-high" | "dark-high";
  schema_version?: 1;
}
/** Friction recorded along a line, the same across it. */
export interface Recording {
  kind: "recording";
  /** CSV with position_mm and mu, or with position_mm and forces; or HJIF of friction. */
  file: string;
  /** The normal force of the recording, where it is no column. */
  normal_force_n?: number | null;
  /** Direction of the line: 0 to the right, 90 down. */
  orientation_deg?: number;
  /** Friction beyond the ends: the lowest, or that of the end. */
  beyond?: "outside" | "hold";
  /** Step of the even grid on which it is kept. */
  step_mm?: number | null;
  schema_version?: 1;
}
/** Bumps and edges that resist uphill and give way downhill, whichever way one strokes. */
export interface Relief {
  kind: "relief";
  /** Quantity of `low` and `high`: shares of the reach of the screen, friction coefficients, or relative changes of friction; see `haptix.feel.as_mu`. */
  target?: "share" | "mu" | "contrast";
  /** Friction at the lowest and at the highest level. */
  low?: number;
  /** Friction at the lowest and at the highest level. */
  high?: number;
  /** Picture of the heights, bright is high. */
  heights?: string | null;
  /** Picture of the surface's normals instead: red to the right, green up, as games have them. */
  normals?: string | null;
  /** Width on the screen. */
  width_mm: number;
  /** Level on the flat; 0 where the relief is added to another material. */
  bias?: number;
  /** Within this from the edges the bias rises from 0. */
  edge_mm?: number;
  schema_version?: 1;
}
/** A slider along x from the origin: ridges between its detents, walls at its ends. */
export interface Slider {
  kind: "slider";
  /** Quantity of `low` and `high`: shares of the reach of the screen, friction coefficients, or relative changes of friction; see `haptix.feel.as_mu`. */
  target?: "share" | "mu" | "contrast";
  /** Friction at the lowest and at the highest level. */
  low?: number;
  /** Friction at the lowest and at the highest level. */
  high?: number;
  /** Width of a ridge. It lies between two detents: friction brakes there, and lets go when the finger has passed. It never pulls the finger anywhere, as a spring would. */
  ridge_mm?: number;
  /** From the first detent to the last. */
  travel_mm?: number;
  /** How many, evenly spaced; or their places [mm], increasing. */
  detents?: number | number[];
  /** Direction of the travel: 0 to the right, 90 down. */
  orientation_deg?: number;
  /** Whether `value` is that of the nearest detent. The screen does not move the finger there. */
  snap?: boolean;
  /** Place of the first detent; places of `detents` count from it. A region needs room before it for the wall. */
  start_mm?: number;
  schema_version?: 1;
}
/** Random friction whose spectrum is given by 13 levels and some waves, as from a recording. */
export interface Spectral {
  kind: "spectral";
  /** Mean, above the friction without voltage. */
  mean?: number;
  /** Levels of the changes [dB], of the whole band around each of 13 wavenumbers, even in their logarithm from 0.1 to 46.4 waves per millimetre. */
  level_db?: number[];
  /** Waves that stand out: period and amplitude of each. */
  waves?: number[][];
  /** What mean and changes are: relative changes of friction, or friction coefficients. */
  target?: "contrast" | "mu";
  /** Length after which it repeats. */
  tile_mm?: number;
  /** Same seed, same pattern. */
  seed?: number;
  /** Direction of the stroke: 0 to the right, 90 down. */
  orientation_deg?: number;
  schema_version?: 1;
}
/** A switch with two sides along x, its corner at the origin. */
export interface Toggle {
  kind: "toggle";
  /** Quantity of `low` and `high`: shares of the reach of the screen, friction coefficients, or relative changes of friction; see `haptix.feel.as_mu`. */
  target?: "share" | "mu" | "contrast";
  /** Friction at the lowest and at the highest level. */
  low?: number;
  /** Friction at the lowest and at the highest level. */
  high?: number;
  /** Width of a ridge. It lies between two detents: friction brakes there, and lets go when the finger has passed. It never pulls the finger anywhere, as a spring would. */
  ridge_mm?: number;
  /** Width; the middle is at half of it. What is left at its default is that of the region. */
  width_mm?: number;
  /** Way over which friction rises. */
  throw_mm?: number;
  schema_version?: 1;
}
/** A curve that begins at an event: a pulse, a sweep, a chain of points, an audio clip. */
export interface Transient {
  kind: "transient";
  /** The event with which it begins. */
  begins?: "start" | "down" | "press" | "release" | "detent";
  /** Shares of the reachable range against time. */
  curve: Signal | number;
  schema_version?: 1;
}
